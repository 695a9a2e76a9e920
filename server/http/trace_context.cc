// SPDX-License-Identifier: Apache-2.0
#include "server/http/trace_context.h"

#include <algorithm>

namespace kdray::server {
namespace {

bool IsHex(std::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

bool IsId(std::string_view text) {
  return IsHex(text) && text.find_first_not_of('0') != std::string_view::npos;
}

}  // namespace

// 00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01
std::optional<TraceContext> ParseTraceparent(std::string_view value) {
  constexpr std::size_t kSize = 55;
  if (value.size() < kSize || value[2] != '-' || value[35] != '-' || value[52] != '-') {
    return std::nullopt;
  }
  const std::string_view version = value.substr(0, 2);
  // Later versions may append further fields.
  const bool has_end = value.size() == kSize || (version != "00" && value[kSize] == '-');
  const TraceContext context{value.substr(3, 32), value.substr(36, 16)};
  if (!has_end || !IsHex(version) || version == "ff" || !IsId(context.trace_id) ||
      !IsId(context.parent_id) || !IsHex(value.substr(53, 2))) {
    return std::nullopt;
  }
  return context;
}

}  // namespace kdray::server
