// SPDX-License-Identifier: Apache-2.0
// Numbers as little-endian bytes on any machine.
#pragma once

#include <bit>
#include <concepts>
#include <cstdint>
#include <string>

namespace kdray::client {

template <std::unsigned_integral T>
void AppendLittleEndian(T value, std::string& out) {
  for (std::size_t i = 0; i < sizeof(T); ++i)
    out.push_back(static_cast<char>(static_cast<std::uint8_t>(value >> (8 * i))));
}

inline void AppendLittleEndian(float value, std::string& out) {
  AppendLittleEndian(std::bit_cast<std::uint32_t>(value), out);
}

inline void AppendLittleEndian(double value, std::string& out) {
  AppendLittleEndian(std::bit_cast<std::uint64_t>(value), out);
}

}  // namespace kdray::client
