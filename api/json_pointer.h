// JSON pointers (RFC 6901), which say where in a body something is wrong.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace kdray::api {

/// One step with its '/' in front. A key is cut after 60 bytes, for it comes from the client.
std::string PointerStep(std::string_view key);
std::string PointerStep(std::size_t index);

}  // namespace kdray::api
