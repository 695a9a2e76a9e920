// SPDX-License-Identifier: Apache-2.0
// glTF 2.0: GLB, and glTF text whose buffers are data: URIs.
#pragma once

#include <cstddef>
#include <span>

#include "core/io/mesh_reader.h"

namespace kdray::core {

/// Reads the triangles of the default scene: that of `scene`, else the first; in a file without
/// scenes, all nodes without a parent. Nodes are taken depth first, a node's mesh before
/// its children, and primitives in their order. Transforms are multiplied and applied in double; a
/// node whose determinant is negative exchanges the second and third corner of its triangles. Each
/// primitive of each node has vertices of its own.
///
/// Triangle i of a strip is (i, i + 1, i + 2), or (i, i + 2, i + 1) for odd i, and of a fan
/// (0, i + 1, i + 2). Points and lines are skipped; a rest of one or two indices after the last
/// triangle counts as a dropped face. Reads KHR_mesh_quantization, EXT_meshopt_compression and
/// sparse accessors; an accessor without any data is an error for positions and indices, though
/// glTF means zeros; ignores skins, morph targets, cameras and everything else. No other file is
/// opened and no address is asked for: a buffer elsewhere is an error.
///
/// Nodes form trees: one that is reached twice is an error, so a small file cannot have more
/// triangles than its nodes times its primitives. What it has is reported to `on_counts` before
/// memory is taken. Errors carry the JSON pointer, or the byte where the container or the JSON is
/// broken; JSON without `asset` is kUnsupportedMeshFormat. See ReadMesh.
Result<MeshData> ReadGltf(std::span<const std::byte> bytes, const MeshReadOptions& options);

}  // namespace kdray::core
