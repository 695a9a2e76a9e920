// SPDX-License-Identifier: Apache-2.0
// The boxes of a tree's nodes, for pictures and study of the tree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/result.h"
#include "core/geometry/bounds3.h"

namespace kdray::core {

struct TreeCell {
  Bounds3d bounds;  ///< local units from a structure, world units from Scene::Cells
  std::uint32_t depth = 0;
  bool leaf = false;
  std::uint64_t triangles = 0;  ///< references in the leaves below; in a leaf, its triangles
};

}  // namespace kdray::core
