// SPDX-License-Identifier: Apache-2.0
// Stanford PLY.
#pragma once

#include <cstddef>
#include <span>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Reads the properties x, y, z of the element `vertex` and the list `vertex_indices` (or
/// `vertex_index`) of the element `face`, or of `tristrips` if there is no face. Other properties
/// and elements, lists included, are skipped; all may come in any order. Formats: ascii,
/// binary_little_endian and binary_big_endian. Rows of an ascii file are lines, or words on any
/// lines. Numbers of type float in ascii become the nearest floats if each of them is the text of a
/// float with as many digits (core/io/printed_float.h); else all become doubles
/// (MeshData::wider_than_declared). Errors carry the line, or the byte in a binary body. See
/// ReadMesh.
Result<MeshData> ReadPly(std::span<const std::byte> bytes, const MeshReadOptions& options);

}  // namespace kdray::core
