// SPDX-License-Identifier: Apache-2.0
#include "core/accel/box/box_list.h"

namespace kdray::core {

Result<std::vector<TreeCell>> BoxList::Cells(std::uint32_t /*depth*/, std::size_t limit,
                                             const CancelToken& /*cancel*/) const {
  std::vector<TreeCell> cells;
  if (bounds.IsEmpty()) return cells;
  if (limit == 0) return Error{ErrorCode::kInvalidArgument, "more than 0 cells"};
  cells.push_back({Bounds3d{Vec3d(bounds.min), Vec3d(bounds.max)}, 0, true, primitives.size()});
  return cells;
}

}  // namespace kdray::core
