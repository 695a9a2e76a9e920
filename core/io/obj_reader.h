// SPDX-License-Identifier: Apache-2.0
// Wavefront OBJ.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Reads `v` (the first three numbers; w and colours after them are skipped) and `f` (`fo` is its
/// old name; the part of a corner before the first slash; negative numbers count back from the last
/// `v` so far; a face may precede its vertices). Every other line is skipped, including points
/// (`p`) and lines (`l`); a line that begins with a number or a control character is an error.
/// Accepts comments, line continuation (a name that ends with a backslash does not join a
/// statement), a byte order mark, any line ends, and padding at the end. Errors carry the line;
/// those of `v` come before those of `f`. See ReadMesh.
Result<MeshData> ReadObj(std::span<const std::byte> bytes, const MeshReadOptions& options);

/// True for a word that begins a statement of an OBJ file.
bool IsObjKeyword(std::string_view word);

}  // namespace kdray::core
