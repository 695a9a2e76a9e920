// SPDX-License-Identifier: Apache-2.0
// A .npy array of version 1.0 from numbers in memory.
#pragma once

#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

namespace kdray::test {

/// `columns` numbers per row, C order, little-endian: `<f4`, `<f8` or `<i4`.
template <class T>
std::string NpyArray(const std::vector<T>& numbers, std::size_t columns) {
  const std::string kind = std::is_integral_v<T> ? "i" : "f";
  std::string header =
      "{'descr': '<" + kind + std::to_string(sizeof(T)) + "', 'fortran_order': False, 'shape': (" +
      std::to_string(numbers.size() / columns) + ", " + std::to_string(columns) + "), }";
  while ((10 + header.size() + 1) % 64 != 0) header += ' ';
  header += '\n';
  std::string file("\x93NUMPY\x01\x00", 8);
  file += static_cast<char>(header.size() & 255);
  file += static_cast<char>(header.size() >> 8);
  file += header;
  const std::size_t bytes = numbers.size() * sizeof(T);
  file.resize(file.size() + bytes);
  if (bytes != 0) std::memcpy(file.data() + file.size() - bytes, numbers.data(), bytes);
  return file;
}

}  // namespace kdray::test
