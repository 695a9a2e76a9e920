#include "core/accel/box/box_list.h"

#include <string>

namespace kdray::core {

Result<std::vector<TreeCell>> BoxList::Cells(std::uint32_t /*depth*/, std::size_t limit,
                                             const CancelToken& /*cancel*/) const {
  std::vector<TreeCell> cells;
  if (bounds.IsEmpty()) return cells;
  if (limit == 0) return Error{ErrorCode::kInvalidArgument, "more than 0 cells"};
  cells.push_back({Bounds3d{Vec3d(bounds.min), Vec3d(bounds.max)}, 0, true, primitives.size()});
  return cells;
}

Status BoxList::Validate(std::size_t triangle_count) const {
  const bool no_triangles = bounds == Bounds3f::Empty();
  if (!no_triangles && (bounds.IsEmpty() || !IsFinite(bounds.Extent()))) {
    return Error{ErrorCode::kCorrupt, "the bounds of the box are invalid"};
  }
  for (const PrimitiveId id : primitives) {
    if (id >= triangle_count) {
      return Error{ErrorCode::kCorrupt, "the box names triangle " + std::to_string(id) + " of " +
                                            std::to_string(triangle_count)};
    }
  }
  return {};
}

}  // namespace kdray::core
