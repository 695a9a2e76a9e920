// SPDX-License-Identifier: Apache-2.0
// Bytes that arrive in pieces and lie in one row: the body of a request.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <new>
#include <span>
#include <string_view>
#include <utility>

namespace kdray::server {

/// Like a std::string that only grows, but large ones grow without a second copy of their bytes:
/// realloc() of a large block moves its pages (mremap), where std::string allocates, copies and
/// frees.
class GrowingBytes {
 public:
  GrowingBytes() = default;
  GrowingBytes(GrowingBytes&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)),
        size_(std::exchange(other.size_, 0)),
        capacity_(std::exchange(other.capacity_, 0)) {}
  GrowingBytes& operator=(GrowingBytes&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(capacity_, other.capacity_);
    return *this;
  }
  ~GrowingBytes() { std::free(data_); }

  /// Throws std::bad_alloc; then nothing has changed.
  void Append(std::span<const std::byte> piece) {
    if (piece.empty()) return;
    if (piece.size() > capacity_ - size_) Grow(size_ + piece.size());
    std::memcpy(data_ + size_, piece.data(), piece.size());
    size_ += piece.size();
  }

  std::string_view view() const { return {data_, size_}; }
  operator std::string_view() const { return view(); }  // NOLINT(google-explicit-constructor)
  std::size_t size() const { return size_; }

 private:
  void Grow(std::size_t needed) {
    // What is reserved beyond the bytes is not touched, so it takes no memory in large blocks.
    const std::size_t capacity = std::max(needed, capacity_ + capacity_ / 2);
    void* moved = std::realloc(data_, capacity);
    if (moved == nullptr) throw std::bad_alloc();
    data_ = static_cast<char*>(moved);
    capacity_ = capacity;
  }

  char* data_ = nullptr;
  std::size_t size_ = 0, capacity_ = 0;
};

}  // namespace kdray::server
