// SPDX-License-Identifier: Apache-2.0
// .npy files built by hand, right and wrong ones.
#pragma once

#include <cstring>
#include <string>
#include <string_view>
#include <vector>

namespace kdray::api {

/// Magic, version, length and `header` as it is, then `data`.
inline std::string NpyFile(std::string_view header, std::string_view data, int version = 1) {
  std::string out = "\x93NUMPY";
  out += static_cast<char>(version);
  out += '\0';
  const std::size_t length_bytes = version == 1 ? 2 : 4;
  for (std::size_t i = 0; i < length_bytes; ++i) {
    out += static_cast<char>(header.size() >> (8 * i) & 0xff);
  }
  return out.append(header).append(data);
}

template <class T>
std::string Bytes(const std::vector<T>& values) {
  std::string out(values.size() * sizeof(T), '\0');
  if (!values.empty()) std::memcpy(out.data(), values.data(), out.size());
  return out;
}

/// 0, 1, 2, …
template <class T>
std::vector<T> Counted(std::size_t n) {
  std::vector<T> out(n);
  for (std::size_t i = 0; i < n; ++i) out[i] = static_cast<T>(i);
  return out;
}

}  // namespace kdray::api
