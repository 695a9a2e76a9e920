// SPDX-License-Identifier: Apache-2.0
// A piece of memory for bytes that are written once: not set to zero, not copied.
#pragma once

#include <cstddef>
#include <memory>
#include <string_view>
#include <utility>

namespace kdray::api {

/// Where the memory of large blocks comes from, and where it goes back to. All blocks of a source
/// have one size. Safe from many threads at once; must outlive its blocks.
class BlockSource {
 public:
  virtual ~BlockSource() = default;
  virtual std::size_t block_bytes() const = 0;
  /// Aligned to a cache line or better. Throws std::bad_alloc.
  virtual char* Take() = 0;
  virtual void GiveBack(char* block) noexcept = 0;
};

class ByteBlock {
 public:
  ByteBlock() = default;
  /// Its bytes are unspecified until they are written.
  explicit ByteBlock(std::size_t size) : ByteBlock(new char[size], size, size, nullptr) {}
  /// Empty, with room for `bytes`.
  static ByteBlock WithRoom(std::size_t bytes) { return {new char[bytes], 0, bytes, nullptr}; }
  /// Empty, with room for a whole block of the source.
  explicit ByteBlock(BlockSource* source)
      : ByteBlock(source->Take(), 0, source->block_bytes(), source) {}

  char* data() { return bytes_.get(); }
  const char* data() const { return bytes_.get(); }
  std::size_t size() const { return size_; }
  /// The bytes of memory that it takes.
  std::size_t capacity() const { return capacity_; }
  std::size_t room() const { return capacity_ - size_; }
  /// `bytes`, at most room(), belong to it from now on; unspecified until they are written.
  void Extend(std::size_t bytes) { size_ += bytes; }
  std::string_view view() const { return {bytes_.get(), size_}; }

 private:
  struct Free {
    BlockSource* source;  ///< null: the heap
    void operator()(char* bytes) const {
      if (source != nullptr) {
        source->GiveBack(bytes);
      } else {
        delete[] bytes;
      }
    }
  };

  ByteBlock(char* bytes, std::size_t size, std::size_t capacity, BlockSource* source)
      : bytes_(bytes, Free{source}), size_(size), capacity_(capacity) {}

  std::unique_ptr<char[], Free> bytes_;
  std::size_t size_ = 0, capacity_ = 0;
};

}  // namespace kdray::api
