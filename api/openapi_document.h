// The contract as /openapi.json serves it: api/openapi.yaml turned into JSON by the build, examples
// included.
#pragma once

#include <string_view>

namespace kdray::api {

std::string_view OpenApiJson();

}  // namespace kdray::api
