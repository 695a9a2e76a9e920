// SPDX-License-Identifier: Apache-2.0
// The header of a PLY file: its elements, their counts and properties.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"

namespace kdray::core {

enum class PlyFormat : std::uint8_t { kAscii, kLittleEndian, kBigEndian };

enum class PlyType : std::uint8_t {
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kInt64,
  kUint64,
  kFloat32,
  kFloat64
};

/// Bytes of a value in a binary file.
inline std::size_t SizeOf(PlyType type) {
  constexpr std::array<std::uint8_t, 10> kSizes = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}
inline bool IsInteger(PlyType type) { return type < PlyType::kFloat32; }

/// A number, or a list of numbers preceded by its length.
struct PlyProperty {
  std::string_view name;
  PlyType type = PlyType::kInt8;
  std::optional<PlyType> count_type = std::nullopt;  ///< of a list; always an integer type
  std::uint64_t line = 0;                            ///< of the header

  bool IsList() const { return count_type.has_value(); }
};

struct PlyElement {
  std::string_view name;
  std::uint64_t count = 0;  ///< rows, as the file claims
  std::uint64_t line = 0;   ///< of the header
  std::vector<PlyProperty> properties;

  /// The index in `properties` of the first property with that name, from `begin` on.
  std::optional<std::size_t> Find(std::string_view property, std::size_t begin = 0) const;
};

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;  ///< in file order; names may be repeated
  std::size_t body = 0;              ///< offset of the first byte after the header
  std::uint64_t body_line = 0;       ///< number of the line that begins there

  /// The first element with that name.
  const PlyElement* Find(std::string_view element) const;
};

/// Reads the header; its names are views into `text`. The first line's end (LF, CR LF, or CR alone)
/// determines how lines end, so a binary body may begin with the byte 10. A line without a keyword
/// is a remark, because some programs omit the word `comment`, unless it looks like a declaration
/// with a misspelt keyword. Errors carry the line, or are those of the poll. Source: Turk, "The PLY
/// Polygon File Format", 1994.
Result<PlyHeader> ParsePlyHeader(std::string_view text, CancelPoll* poll);

}  // namespace kdray::core
