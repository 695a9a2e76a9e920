// Stanford PLY.
#pragma once

#include <cstddef>
#include <span>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Takes the properties x, y, z of the element `vertex` and the list `vertex_indices` (or
/// `vertex_index`) of the element `face`, or, when there is no face, of `tristrips`; other
/// properties, lists too, and other elements are skipped, all in any order. ascii,
/// binary_little_endian and binary_big_endian. Rows of an ascii file are lines, or words on any
/// lines. Its numbers of type float are the nearest floats when every one of them, printed as a
/// float with as many digits, is that very text (core/io/printed_float.h); else all are doubles
/// (MeshData::wider_than_declared). Errors carry the line, or the byte in a binary body. See
/// ReadMesh.
Result<MeshData> ReadPly(std::span<const std::byte> bytes, const MeshReadOptions& options);

}  // namespace kdray::core
