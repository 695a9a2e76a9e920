// From a mesh file to a mesh with its facts, and the memory that this takes, computed from the
// file's counts before the memory is taken.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/catalog/parsed_mesh.h"
#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Parses, validates and judges a mesh file, in the caller's arena. Errors: those of ReadMesh and
/// TriangleMesh::Create.
Result<PreparedMesh> PrepareMesh(std::span<const std::byte> bytes, const CancelToken& cancel);

/// Told what a file holds before memory is taken for it; its error ends the work.
using OnMeshCounts = std::function<Status(const MeshCounts&)>;

/// As the other PrepareMesh, but the bytes are freed as soon as they are parsed. Errors besides:
/// those of `on_counts`.
Result<PreparedMesh> PrepareMesh(std::vector<std::byte> bytes, const CancelToken& cancel,
                                 const OnMeshCounts& on_counts);

/// Memory that this PrepareMesh holds at its peak, the bytes included. An upper bound, which meshes
/// with float vertices stay below by up to a third.
std::uint64_t PreparePeakBytes(std::uint64_t file_bytes, const MeshCounts& counts);

/// What usual files come to while they are prepared, `file_bytes` of input included, for those
/// whose counts are not known yet; others need up to 25 times as much as their bytes. With counts:
/// PreparePeakBytes.
constexpr std::uint64_t EstimatePrepareBytes(std::uint64_t file_bytes) { return 5 * file_bytes; }

/// What no mesh of so many bytes can do without: its bytes are held while they are parsed.
constexpr std::uint64_t LeastPrepareBytes(std::uint64_t file_bytes) { return file_bytes + 4096; }

/// Memory of a mesh, at least, of which only the counts are known.
std::uint64_t LeastMeshBytes(const MeshCounts& counts);

}  // namespace kdray::core
