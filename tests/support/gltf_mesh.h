// SPDX-License-Identifier: Apache-2.0
// Reads glTF 2.0 files into MeshData independently of core/io/gltf_reader.h, as an oracle for it,
// and for tests that need the closed meshes of the collection.
#pragma once

#include <cstddef>
#include <span>

#include "core/geometry/triangle_mesh.h"

namespace kdray::test {

/// The triangles of a GLB file, or of a glTF file whose buffers are `data:` URIs: those of its
/// default scene (else the first), depth first, with the transforms of their nodes applied in
/// double, without skins and morph targets. Every primitive has its own vertices, also if it is
/// used twice. MeshData::format is not set.
///
/// Throws an exception derived from std::exception for an invalid file, and for features that no
/// closed mesh of the collection needs: buffers in other files, required extensions, strips and
/// fans, points and lines, and positions that are not floats.
core::MeshData ReadGltf(std::span<const std::byte> bytes);

}  // namespace kdray::test
