// SPDX-License-Identifier: Apache-2.0
// Converts a binary structure to its wide form.
#pragma once

#include <cstdint>

#include "core/accel/box/box_list.h"
#include "core/accel/build_monitor.h"
#include "core/accel/bvh/bvh.h"
#include "core/accel/kdtree/kd_tree.h"
#include "core/accel/wide/wide_tree.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// The wide tree with the smallest expected cost among all eight-wide trees that the binary one
/// contains. A dynamic program chooses the number of a node's eight places that each subtree gets.
/// A visited node costs as much as a tested block, weighted by the surface area of the node's
/// bounds. Empty leaves are dropped. O(nodes) time and memory; the same for any number of threads.
/// Needs KdTree::node_bounds. Source: Wald, Benthin, Boulos 2008 (wide nodes from binary trees);
/// Ylitie, Karras, Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide
/// BVHs", 2017, section 4.1 (the dynamic program). Unspecified if the monitor stops.
WideTree Collapse(const TriangleMesh& mesh, const KdTree& tree, BuildMonitor* monitor);
WideTree Collapse(const TriangleMesh& mesh, const Bvh& bvh, BuildMonitor* monitor);
WideTree Collapse(const TriangleMesh& mesh, const BoxList& box, BuildMonitor* monitor);

/// Upper bound of Collapse's memory, its result included. O(nodes).
std::uint64_t CollapseBytes(const KdTree& tree);
std::uint64_t CollapseBytes(const Bvh& bvh);
std::uint64_t CollapseBytes(const BoxList& box);

}  // namespace kdray::core
