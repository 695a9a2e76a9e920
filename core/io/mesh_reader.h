// SPDX-License-Identifier: Apache-2.0
// Reads mesh files into MeshData. There is one reader per format; this one detects the format from
// the bytes alone.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Upper bounds of a file's content, counted before memory is allocated for it.
struct MeshCounts {
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  std::uint64_t most_corners = 0;  ///< of a polygon
  std::uint64_t most_cut = 0;      ///< of a polygon that may need ear clipping
  std::uint64_t other_bytes = 0;   ///< memory of the reader and the attributes besides

  /// Counts a polygon, in the counting pass.
  void AddFace(std::uint64_t corners);
  /// Memory of ReadMesh at its peak, without the file's bytes.
  std::uint64_t ReadBytes() const;
};

class AttributeSink;

struct MeshReadOptions {
  CancelToken cancel;
  /// Called with the counts before memory is allocated for them, and again when more is known. Its
  /// error ends the reading.
  std::function<Status(const MeshCounts&)> on_counts = nullptr;
  /// Gets what the file says besides triangles (core/io/attribute_sink.h); null if not asked for.
  AttributeSink* attributes = nullptr;

  Status Counted(const MeshCounts& counts) const {
    return on_counts ? on_counts(counts) : Status();
  }
};

/// Parses OBJ, PLY (ascii, both byte orders), STL (ascii, binary), OFF (ascii), GLB or glTF (with
/// embedded buffers), detected from the bytes alone. Polygons with n corners become n - 2 triangles
/// in place: a convex one is fanned from its first corner, any other is triangulated by ear
/// clipping (core/io/polygon.h). Faces with fewer than three corners are dropped and counted.
/// Coordinates of text files are read as doubles; those that an ascii PLY file declares as floats
/// are read as floats if all are printed floats. Errors: kUnsupportedMeshFormat (no format fits, or
/// an unsupported variant; the message names the formats), kEmptyMesh, kInvalidMesh with
/// Error::line (text, and the header of PLY) or Error::byte (binary, and the container and JSON of
/// glTF) or a JSON pointer in the message (glTF), and the cause, kMeshTooLarge, kCancelled,
/// kDeadlineExceeded. A coordinate that is not finite or beyond kMaxCoordinate is kInvalidMesh only
/// in a vertex that a triangle uses.
///
/// Every count in a file is a claim, reported to `on_counts` before memory is allocated for it.
/// Memory is allocated for what the bytes can contain: at most 2x the body beyond the result (for
/// an invalid file: beyond the result of the part before the error), and
/// PolygonCutter::kScratchBytesPerCorner for each corner of the largest concave polygon, 46 MB at
/// most. The JSON of glTF takes more than its text, some 100 bytes a value, and compressed views of
/// glTF take what they decode to, up to 64 times their bytes; `on_counts` is told before
/// (MeshCounts::other_bytes). Safe from many threads at once. O(bytes), and O(n log n) for usual
/// concave polygons of n corners; PolygonCutter bounds what polygons may cost.
Result<MeshData> ReadMesh(std::span<const std::byte> bytes, const MeshReadOptions& options = {});

}  // namespace kdray::core
