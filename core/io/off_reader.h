// OFF, the Object File Format of Geomview, ascii.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Takes the first three numbers of each vertex line, whatever the keyword announces behind them
/// (colours, normals, texture coordinates), and the corners of each face line, but not the colours
/// behind them. The keyword may lack, or stand on the line of the counts; the count of edges may
/// lack. Comments begin with #. The binary form and the ones with another dimension than 3 are
/// refused (kUnsupportedMeshFormat). Errors carry the line. See ReadMesh.
Result<MeshData> ReadOff(std::span<const std::byte> bytes, const MeshReadOptions& options);

/// True for OFF with its prefixes (ST, C, N, 4, n, in this order), also with the first count glued
/// to it.
bool IsOffKeyword(std::string_view word);

}  // namespace kdray::core
