// SPDX-License-Identifier: Apache-2.0
// The data of a query: a mesh and one tree over it.
#pragma once

#include <memory>
#include <vector>

#include "core/accel/tree.h"
#include "core/accel/tree_cell.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Shared and immutable. Several trees may share one mesh.
struct Scene {
  std::shared_ptr<const TriangleMesh> mesh;
  std::shared_ptr<const Tree> tree;
  bool is_closed = false;  ///< MeshHealth::closed; unknown counts as false

  /// The nodes at `depth` and the leaves above it, in world units; kInvalidArgument if there are
  /// more than `limit`. The first call rebuilds the binary tree. Errors: kCancelled,
  /// kDeadlineExceeded.
  Result<std::vector<TreeCell>> Cells(std::uint32_t depth, std::size_t limit,
                                      const CancelToken& cancel = {}) const;
};

}  // namespace kdray::core
