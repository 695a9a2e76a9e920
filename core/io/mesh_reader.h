// Mesh files to MeshData. One reader per format; this one finds the format from the bytes alone.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// What a file holds, as it was counted before memory is taken for it. Upper bounds.
struct MeshCounts {
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  std::uint64_t most_corners = 0;  ///< of a polygon
  std::uint64_t most_cut = 0;      ///< of a polygon that may have to be cut by ears

  /// A polygon, in the counting pass.
  void AddFace(std::uint64_t corners);
  /// Memory of ReadMesh at its peak, without the file's bytes.
  std::uint64_t ReadBytes() const;
};

struct MeshReadOptions {
  CancelToken cancel;
  /// Told the counts before memory is taken for them, again when more is known. Its error ends the
  /// reading.
  std::function<Status(const MeshCounts&)> on_counts = nullptr;

  Status Counted(const MeshCounts& counts) const {
    return on_counts ? on_counts(counts) : Status();
  }
};

/// Parses OBJ, PLY (ascii, both byte orders), STL (ascii, binary) or OFF (ascii), found from the
/// bytes alone. Polygons with n corners become n - 2 triangles in place: a convex one is fanned
/// from its first corner, another is cut by ears (core/io/polygon.h). Faces with fewer than three
/// corners are dropped and counted. Coordinates of text files are read as doubles,
/// but those that an ascii PLY file calls floats as floats where they are. Errors:
/// kUnsupportedMeshFormat (no format fits, or a variant that is not read; names the formats there
/// are), kEmptyMesh, kInvalidMesh with Error::line (text, and the header of PLY) or Error::byte
/// (binary) and the cause, kMeshTooLarge, kCancelled, kDeadlineExceeded. A coordinate that is not
/// finite or beyond kMaxCoordinate is kInvalidMesh in a vertex that a triangle uses, and only
/// there.
///
/// Every count in a file is a claim, told to `on_counts` before memory is taken for it. Memory is
/// taken for what the bytes can hold, at most 2x the body beyond the result (of a file that is
/// refused: beyond the result of the part before the fault), and
/// PolygonCutter::kScratchBytesPerCorner for each corner of the largest concave polygon, 46 MB at
/// most. Safe from many threads at once. O(bytes), and O(n log n) for usual concave polygons of n
/// corners; PolygonCutter bounds what polygons may cost.
Result<MeshData> ReadMesh(std::span<const std::byte> bytes, const MeshReadOptions& options = {});

}  // namespace kdray::core
