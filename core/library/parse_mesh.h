// SPDX-License-Identifier: Apache-2.0
// Parses a mesh file to a mesh with its facts, and computes the memory for that from the file's
// counts before it is allocated.
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

/// Parses and validates a mesh file and makes its health report, in the caller's arena. Errors:
/// those of ReadMesh and TriangleMesh::Create.
Result<ParsedMesh> ParseMesh(std::span<const std::byte> bytes, const CancelToken& cancel);

/// Called with a file's counts before memory is allocated for them; its error ends the work.
using OnMeshCounts = std::function<Status(const MeshCounts&)>;

/// As the other ParseMesh, but frees the bytes after parsing. Additional errors: those of
/// `on_counts`.
Result<ParsedMesh> ParseMesh(std::vector<std::byte> bytes, const CancelToken& cancel,
                             const OnMeshCounts& on_counts);

/// Upper bound of this ParseMesh's peak memory, the bytes included. Meshes with float vertices
/// need up to a third less.
std::uint64_t ParsePeakBytes(std::uint64_t file_bytes, const MeshCounts& counts);

/// Upper bound of the peak memory of ReadMesh alone, the bytes included.
std::uint64_t ReadPeakBytes(std::uint64_t file_bytes, const MeshCounts& counts);

/// Memory to prepare a usual file whose counts are not known yet, `file_bytes` of input included;
/// others need up to 21 times their bytes. With counts: ParsePeakBytes.
constexpr std::uint64_t EstimateParseBytes(std::uint64_t file_bytes) { return 5 * file_bytes; }

/// Lower bound for any mesh of this size: its bytes are held during parsing.
constexpr std::uint64_t LeastParseBytes(std::uint64_t file_bytes) { return file_bytes + 4096; }

/// Lower bound of a mesh's memory, by its counts.
std::uint64_t LeastMeshBytes(const MeshCounts& counts);

}  // namespace kdray::core
