// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/picture_size.h"

#include <charconv>

#include "kdray/error.h"

namespace kdray::client {

PictureSize ParsePictureSize(const std::string& text) {
  PictureSize size;
  const char* const end = text.data() + text.size();
  const auto width = std::from_chars(text.data(), end, size.width);
  const bool has_cross = width.ec == std::errc() && width.ptr != end && *width.ptr == 'x';
  if (has_cross) {
    const auto height = std::from_chars(width.ptr + 1, end, size.height);
    if (height.ec == std::errc() && height.ptr == end && size.width > 0 && size.height > 0) {
      return size;
    }
  }
  throw UsageError("--size takes width and height in pixels, as 1920x1080, not '" + text + "'");
}

}  // namespace kdray::client
