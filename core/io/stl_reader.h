// STL, binary and ascii.
#pragma once

#include <cstddef>
#include <span>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Every triangle has three vertices of its own, in file order. Normals, colours and names are
/// skipped; several solids in an ascii file are one mesh. Bytes of the very size that the count at
/// byte 80 asks for are a binary file, even when they begin with "solid". Ascii keywords may be in
/// any case; words behind a complete statement on its line are ignored, and the last endsolid may
/// lack. A coordinate that is not finite is refused here, since triangles use every vertex. Errors
/// carry the line, or the byte of a binary file. See ReadMesh.
Result<MeshData> ReadStl(std::span<const std::byte> bytes, const MeshReadOptions& options);

/// Whether the bytes are as long as a binary STL with their count has to be: nearly a proof, since
/// text at byte 80 would be a count of more than 80 million.
bool HasBinaryStlSize(std::span<const std::byte> bytes);

}  // namespace kdray::core
