// SPDX-License-Identifier: Apache-2.0
// Encodes sample meshes in the mesh formats of the service.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "clients/cpp/sample/sample_mesh.h"

namespace kdray::client {

enum class MeshFormat { kObj, kPly, kStl };

/// The format of a file name's ending (.obj, .ply, .stl, in any case); nullopt for others.
std::optional<MeshFormat> MeshFormatOf(std::string_view file_name);

/// OBJ as text, PLY and STL binary little-endian. Coordinates are written as 32-bit floats (OBJ:
/// with the digits that give the same float back). The same mesh gives the same bytes everywhere.
std::string EncodeMesh(const SampleMesh& mesh, MeshFormat format);

}  // namespace kdray::client
