// SPDX-License-Identifier: Apache-2.0
// The compressed buffer views of a glTF file (EXT_meshopt_compression), decoded by
// libmeshoptimizer. The only place that knows the library. The filters are in
// core/io/meshopt_filters.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/io/meshopt_filters.h"

namespace kdray::core {

enum class MeshoptMode : std::uint8_t { kAttributes, kTriangles, kIndices };

/// What a view says of its content. All of it is a claim.
struct MeshoptForm {
  MeshoptMode mode = MeshoptMode::kAttributes;
  MeshoptFilter filter = MeshoptFilter::kNone;
  std::uint64_t stride = 0;  ///< bytes of an element
  std::uint64_t count = 0;   ///< of elements; of indices, not of triangles

  /// Decoded, of a form that WhyNotMeshopt accepts.
  std::uint64_t Bytes() const { return stride * count; }
};

/// Bytes of a decoded view at most: the library decodes a view in one piece, which takes a quarter
/// of a second at most on a processor that decodes 256 MB/s, a tenth of what usual ones do.
inline constexpr std::uint64_t kMaxMeshoptBytes = std::uint64_t{64} << 20;

/// Why `encoded_bytes` bytes are no such view: the extension does not allow its stride, count or
/// filter, or the bytes are fewer than its elements need. The text ends a sentence that begins with
/// the view. nullopt if the view may be decoded. O(1).
std::optional<std::string> WhyNotMeshopt(const MeshoptForm& form, std::uint64_t encoded_bytes);

/// Decodes a view whose form WhyNotMeshopt accepts into `decoded`, which has form.Bytes() bytes.
/// Any input is safe; damaged input may decode to any values. Errors: kInvalidMesh with the cause
/// alone, or those of the poll, which is asked before and after the library's work.
Status DecodeMeshopt(const MeshoptForm& form, std::span<const std::byte> encoded,
                     std::span<std::byte> decoded, CancelPoll* poll);

}  // namespace kdray::core
