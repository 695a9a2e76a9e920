// SPDX-License-Identifier: Apache-2.0
// Decodes the fields of pictures, from a query or from JSON, with the default limits.
#pragma once

#include <string_view>

#include "api/limits.h"
#include "api/request_codec.h"

namespace kdray::api {

inline const Limits kLimits;

inline Outcome<RenderRequest> Query(std::string_view query) {
  return DecodeRenderQuery(query, ImageForm::kPng, kLimits);
}
inline Outcome<RenderRequest> Body(std::string_view body) {
  return DecodeRenderBody(body, ImageForm::kPng, "application/json", kLimits);
}

}  // namespace kdray::api
