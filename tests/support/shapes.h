// SPDX-License-Identifier: Apache-2.0
// Meshes from formulas, for tests that need known geometry. Sizes and positions are in world units;
// the same arguments give the same mesh on every machine.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"

namespace kdray::test {

/// Rounds every coordinate to the nearest float, so the mesh gets 12-byte vertices unless its
/// position prevents it.
core::MeshData RoundToFloat(core::MeshData mesh);

/// Both meshes, b's vertices and triangles after a's.
core::MeshData Join(core::MeshData a, const core::MeshData& b);

// Closed 2-manifolds, triangles counter-clockwise seen from outside, `center` strictly inside.

/// Rings of quads between two poles: 2 * segments * (rings - 1) triangles; rings >= 2, segments >=
/// 3.
core::MeshData UvSphere(const core::Vec3d& center, double radius, int rings, int segments);
/// A UvSphere whose radius swings by up to `amplitude` (a fraction below 1): every point of the
/// surface is seen from the centre.
core::MeshData BumpySphere(const core::Vec3d& center, double radius, int rings, int segments,
                           double amplitude);
/// An icosahedron, each triangle split into four `subdivisions` times: 20 * 4^subdivisions
/// triangles of similar size.
core::MeshData IcoSphere(const core::Vec3d& center, double radius, int subdivisions);
/// Twelve triangles, axis-aligned.
core::MeshData Cube(const core::Vec3d& center, double half_edge);

// Open meshes and soups.

/// A flat unit square at `height` across `axis`, in cells x cells quads of two triangles each.
core::MeshData Grid(int cells, int axis, double height);
/// `count` triangles with corners within `size` of points that fill the unit cube evenly.
core::MeshData Soup(std::size_t count, double size, std::uint64_t stream);
/// `count` copies of one triangle that is parallel to no axis.
core::MeshData Coincident(std::size_t count);
/// `count` large triangles around the origin: any plane near the middle crosses all of them.
core::MeshData Straddling(std::size_t count, std::uint64_t stream);
/// `teeth` long thin blades side by side, four triangles each: needles for every split across
/// their length.
core::MeshData Comb(std::size_t teeth);
/// A thin ribbon wound `turns` times around an axis, from the middle outward, cut into `count`
/// triangles.
core::MeshData Spiral(std::size_t count, int turns);
/// `count` small triangles in a row along the diagonal of the unit cube, evenly spaced and apart.
core::MeshData Staircase(std::size_t count);
/// Cubes around the origin, each twice as large as the one inside: `levels` powers of two.
core::MeshData Nest(int levels);

}  // namespace kdray::test
