// SPDX-License-Identifier: Apache-2.0
#include "server/handler.h"

#include <array>
#include <cstdio>
#include <utility>

namespace kdray::server {

std::string ServerTiming::Format() const {
  char entry[48];
  std::snprintf(entry, sizeof(entry), "queue;dur=%.3f", queue_ms);
  std::string text = entry;
  const std::array parts = {std::pair("parse", parse_ms), std::pair("build", build_ms),
                            std::pair("trace", trace_ms), std::pair("encode", encode_ms)};
  for (const auto& [name, ms] : parts) {
    if (!ms) continue;
    std::snprintf(entry, sizeof(entry), ", %s;dur=%.3f", name, *ms);
    text += entry;
  }
  return text;
}

}  // namespace kdray::server
