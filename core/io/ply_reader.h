// Stanford PLY.
#pragma once

#include <cstddef>
#include <span>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Takes the properties x, y, z of the element `vertex` and the list `vertex_indices` (or
/// `vertex_index`) of the element `face`; other properties, lists too, and other elements are
/// skipped, all in any order. ascii, binary_little_endian and binary_big_endian; the numbers of an
/// ascii file are read as doubles even where the header says float. Triangle strips are refused.
/// Errors carry the line, or the byte in a binary body. See ReadMesh.
Result<MeshData> ReadPly(std::span<const std::byte> bytes, const MeshReadOptions& options);

}  // namespace kdray::core
