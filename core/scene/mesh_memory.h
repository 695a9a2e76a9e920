// What becomes of a mesh file in memory, computed from its counts before the memory is taken.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/io/mesh_reader.h"
#include "core/scene/prepared_mesh.h"

namespace kdray::core {

/// Told what a file holds before memory is taken for it; its error ends the work.
using OnMeshCounts = std::function<Status(const MeshCounts&)>;

/// As the other PrepareMesh, but the bytes are freed as soon as they are parsed. Errors besides:
/// those of `on_counts`.
Result<PreparedMesh> PrepareMesh(std::vector<std::byte> bytes, const CancelToken& cancel,
                                 const OnMeshCounts& on_counts);

/// Memory that this PrepareMesh holds at its peak, the bytes included. An upper bound, which meshes
/// with float vertices stay below by up to a third.
std::uint64_t PreparePeakBytes(std::uint64_t file_bytes, const MeshCounts& counts);

/// Memory of a mesh, at least, of which only the counts are known.
std::uint64_t LeastMeshBytes(const MeshCounts& counts);

}  // namespace kdray::core
