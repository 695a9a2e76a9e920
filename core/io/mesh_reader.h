// Mesh files to MeshData. One reader per format; this one finds the format from the bytes alone.
#pragma once

#include <cstddef>
#include <span>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

struct MeshReadOptions {
  CancelToken cancel;
};

/// Parses OBJ, PLY (ascii, both byte orders), STL (ascii, binary) or OFF. Polygons with n corners
/// become n - 2 triangles in place: a convex one is fanned from its first corner, another is cut by
/// ears. Faces with fewer than three corners are dropped and counted. Errors:
/// kUnsupportedMeshFormat (no format fits; names those there are), kEmptyMesh, kInvalidMesh with
/// the line or byte and the cause, kMeshTooLarge, kCancelled. Every count in a file is a claim:
/// memory is allocated for what the bytes can hold, at most 2x the body beyond what is returned.
/// Safe from many threads at once. O(bytes), and O(n^2) for a concave polygon of n corners.
Result<MeshData> ReadMesh(std::span<const std::byte> bytes, const MeshReadOptions& options = {});

}  // namespace kdray::core
