// SPDX-License-Identifier: Apache-2.0
#include "api/json_pointer.h"

namespace kdray::api {

std::string PointerStep(std::string_view key) {
  constexpr std::size_t kMost = 60;
  std::string step = "/";
  for (const char c : key.substr(0, kMost)) {
    if (c == '~') {
      step += "~0";
    } else if (c == '/') {
      step += "~1";
    } else {
      step += c;
    }
  }
  return step;
}

std::string PointerStep(std::size_t index) { return PointerStep(std::to_string(index)); }

}  // namespace kdray::api
