// SPDX-License-Identifier: Apache-2.0
// Checks of finished trees against the mesh, by walking them in the plainest way.
#pragma once

#include <cstddef>

#include "core/accel/box/box_list.h"
#include "core/accel/bvh/bvh.h"
#include "core/accel/kdtree/kd_tree.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::test {

/// Expects, for corners, edge midpoints and random points of every triangle that is not degenerate,
/// a leaf that refers to the triangle and whose closed cell contains the point, as do the bounds of
/// all nodes on the way, where they are kept.
void CheckReachability(const core::KdTree& tree, const core::TriangleMesh& mesh);
void CheckReachability(const core::Bvh& tree, const core::TriangleMesh& mesh);
void CheckReachability(const core::BoxList& tree, const core::TriangleMesh& mesh);

/// Expects what traversals and Collapse() rely on: every index is in range, children follow their
/// parents depth first, planes and boxes are finite, and the depth is at most kMaxDepth.
void CheckLayout(const core::KdTree& tree, std::size_t triangle_count);
void CheckLayout(const core::Bvh& tree, std::size_t triangle_count);
void CheckLayout(const core::BoxList& tree, std::size_t triangle_count);

}  // namespace kdray::test
