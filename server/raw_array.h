// SPDX-License-Identifier: Apache-2.0
// An array of numbers whose memory is not set to zero first: it is written before it is read.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <type_traits>

namespace kdray::server {

/// Elements are copied like bytes, and are unspecified until they are written.
template <class T>
class RawArray {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  explicit RawArray(std::size_t size) : data_(std::allocator<T>().allocate(size)), size_(size) {}
  RawArray(const RawArray&) = delete;
  RawArray& operator=(const RawArray&) = delete;
  ~RawArray() { std::allocator<T>().deallocate(data_, size_); }

  std::span<T> first(std::size_t count) { return {data_, count}; }
  std::span<const T> first(std::size_t count) const { return {data_, count}; }

 private:
  T* data_;
  std::size_t size_;
};

}  // namespace kdray::server
