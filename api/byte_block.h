// SPDX-License-Identifier: Apache-2.0
// A piece of memory for bytes that are written once: not set to zero, not copied.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string_view>
#include <utility>

namespace kdray::api {

class ByteBlock {
 public:
  ByteBlock() = default;
  /// Its bytes are unspecified until they are written.
  explicit ByteBlock(std::size_t size)
      : bytes_(std::make_unique_for_overwrite<char[]>(size)), size_(size) {}

  char* data() { return bytes_.get(); }
  std::size_t size() const { return size_; }
  std::string_view view() const { return {bytes_.get(), size_}; }

 private:
  std::unique_ptr<char[]> bytes_;
  std::size_t size_ = 0;
};

}  // namespace kdray::api
