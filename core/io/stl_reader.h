// SPDX-License-Identifier: Apache-2.0
// STL, binary and ascii.
#pragma once

#include <cstddef>
#include <span>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Every triangle has three vertices of its own, in file order. Normals, colours and names are
/// skipped; several solids in an ascii file are one mesh. A file with exactly the size that the
/// count at byte 80 requires is binary, even if it begins with "solid". Ascii keywords may be in
/// any case; words after a complete statement on its line are ignored, and the last endsolid may be
/// missing. A coordinate that is not finite is an error, because triangles use every vertex. Errors
/// carry the line, or the byte of a binary file. See ReadMesh.
Result<MeshData> ReadStl(std::span<const std::byte> bytes, const MeshReadOptions& options);

/// Whether the size is that of a binary STL with the count at byte 80. Nearly a proof: text at byte
/// 80 would be a count of more than 80 million.
bool HasBinaryStlSize(std::span<const std::byte> bytes);

}  // namespace kdray::core
