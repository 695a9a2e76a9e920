// SPDX-License-Identifier: Apache-2.0
// JSON pointers (RFC 6901), which locate errors in a body.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace kdray::api {

/// One step, preceded by '/'. A key is cut after 60 bytes, because it comes from the client.
std::string PointerStep(std::string_view key);
std::string PointerStep(std::size_t index);

}  // namespace kdray::api
