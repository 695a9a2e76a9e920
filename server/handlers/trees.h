// Meshes in, tree ids out: /v1/trees and below.
#pragma once

#include "server/call.h"

namespace kdray::server {

api::Outcome<HttpResponse> PostTree(const Services& services, Call& call);
api::Outcome<HttpResponse> ListTrees(const Services& services, Call& call);
api::Outcome<HttpResponse> GetTree(const Services& services, Call& call);
api::Outcome<HttpResponse> DeleteTree(const Services& services, Call& call);
api::Outcome<HttpResponse> GetMesh(const Services& services, Call& call);

}  // namespace kdray::server
