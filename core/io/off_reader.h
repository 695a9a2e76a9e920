// SPDX-License-Identifier: Apache-2.0
// OFF, the Object File Format of Geomview, ascii.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Reads the first three numbers of each vertex and skips those that the keyword announces after
/// them (colours, normals, texture coordinates). Reads the corners of each face and skips its
/// colour, which ends with the line. Rows are lines, as programs write them, or numbers on any
/// lines, as Geomview's manual allows; a count may be written as "8.0". The keyword may be missing,
/// or precede the counts on their line; the count of edges may be missing. Comments begin with #.
/// The binary form, dimensions other than 3 and lists of points are kUnsupportedMeshFormat. Errors
/// carry the line. See ReadMesh.
Result<MeshData> ReadOff(std::span<const std::byte> bytes, const MeshReadOptions& options);

/// True for OFF with its prefixes (ST, C, N, 4, n, in any order), also with the first count glued
/// to it.
bool IsOffKeyword(std::string_view word);

}  // namespace kdray::core
