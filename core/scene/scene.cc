// SPDX-License-Identifier: Apache-2.0
#include "core/scene/scene.h"

namespace kdray::core {

Result<std::vector<TreeCell>> Scene::Cells(std::uint32_t depth, std::size_t limit,
                                           const CancelToken& cancel) const {
  const auto binary = tree->Binary(*mesh, BuildOptions{cancel});
  if (!binary.ok()) return binary.error();
  Result<std::vector<TreeCell>> cells = std::visit(
      [&](const auto& structure) { return structure.Cells(depth, limit, cancel); }, **binary);
  if (!cells.ok()) return cells;
  for (TreeCell& cell : *cells) {
    cell.bounds.min = mesh->frame().ToWorld(cell.bounds.min);
    cell.bounds.max = mesh->frame().ToWorld(cell.bounds.max);
  }
  return cells;
}

}  // namespace kdray::core
