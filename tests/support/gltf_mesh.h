// glTF 2.0 files to MeshData, for tests: core reads none, and the collection has closed meshes that
// come in no other format.
#pragma once

#include <cstddef>
#include <span>

#include "core/geometry/triangle_mesh.h"

namespace kdray::test {

/// The triangles of a GLB file, or of a glTF file whose buffers are `data:` URIs: those of its
/// default scene (the first one when it names none), depth first, with the transforms of their
/// nodes applied in double; skins and morph targets are left out. Every primitive brings its own
/// vertices, also when it is shown twice. MeshData::format says nothing here.
///
/// Throws what derives from std::exception for a damaged file, and for what no closed mesh of the
/// collection needs: buffers in other files, extensions that must be known, strips and fans,
/// points and lines, and positions that are not floats.
core::MeshData ReadGltf(std::span<const std::byte> bytes);

}  // namespace kdray::test
