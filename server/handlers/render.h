// Images: /v1/trees/{id}/render.png and render.npy, the fields as parameters (GET) or as JSON
// (POST).
#pragma once

#include "server/call.h"

namespace kdray::server {

api::Outcome<HttpResponse> GetRenderPng(const Services& services, Call& call);
api::Outcome<HttpResponse> PostRenderPng(const Services& services, Call& call);
api::Outcome<HttpResponse> GetRenderNpy(const Services& services, Call& call);
api::Outcome<HttpResponse> PostRenderNpy(const Services& services, Call& call);

}  // namespace kdray::server
