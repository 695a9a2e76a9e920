// OFF, the Object File Format of Geomview, ascii.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Takes the first three numbers of each vertex, whatever the keyword announces behind them
/// (colours, normals, texture coordinates), and the corners of each face, but not the colours
/// behind them, which end with the line. Rows are lines, as programs write them, or numbers on any
/// lines, as Geomview's manual allows; a count may be written as "8.0". The keyword may lack, or
/// stand on the line of the counts; the count of edges may lack. Comments begin with #. The binary
/// form and the ones with another dimension than 3 are refused (kUnsupportedMeshFormat), as is a
/// list of points. Errors carry the line. See ReadMesh.
Result<MeshData> ReadOff(std::span<const std::byte> bytes, const MeshReadOptions& options);

/// True for OFF with its prefixes (ST, C, N, 4, n, in any order), also with the first count glued
/// to it.
bool IsOffKeyword(std::string_view word);

}  // namespace kdray::core
