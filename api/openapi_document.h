// SPDX-License-Identifier: Apache-2.0
// The contract as served at /openapi.json: api/openapi.yaml, converted to JSON by the build, with
// its examples.
#pragma once

#include <string_view>

namespace kdray::api {

std::string_view OpenApiJson();

}  // namespace kdray::api
