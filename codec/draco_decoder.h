// SPDX-License-Identifier: Apache-2.0
// Decodes a Draco mesh for core/io/draco_process.h, in a process of its own (codec/main.cc). The
// only place that knows the library.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace kdray::codec {

/// An attribute that the caller wants, as its glTF accessor describes it.
struct WantedAttribute {
  std::uint32_t id = 0;    ///< its unique id in the data
  int component_type = 0;  ///< 5120 to 5126, as in glTF
  int components = 0;      ///< of a value
  bool is_needed = false;  ///< its absence is an error
};

/// What the data must be.
struct DracoClaims {
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  std::vector<WantedAttribute> attributes;
};

/// Attributes of a mesh at most, wanted or not: all of them are decoded.
inline constexpr int kMaxDracoAttributes = 32;

/// The answer for triangle data of bitstream version 2.2, which glTF names. It begins with 'm':
/// then come the corners, three numbers of 32 bits for each triangle, and for each attribute a byte
/// that says whether it is there (1) or not (0), and its values if it is, those of a vertex after
/// each other. Or it begins with 'e', and a text says what is wrong with the data. Each index is
/// below claims.vertices. Numbers are little-endian.
///
/// The library's time grows with the square of the triangles in the worst case, its memory with
/// what the data claim: the process has limits for both.
std::string DecodeDraco(std::span<const char> data, const DracoClaims& claims);

}  // namespace kdray::codec
