// SPDX-License-Identifier: Apache-2.0
// `--size WIDTHxHEIGHT`.
#pragma once

#include <cstdint>
#include <string>

namespace kdray::client {

struct PictureSize {
  std::uint64_t width = 0, height = 0;  ///< pixels, above 0
};

/// "1920x1080". Throws UsageError for anything else; the server checks the limits.
PictureSize ParsePictureSize(const std::string& text);

}  // namespace kdray::client
