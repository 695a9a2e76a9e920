// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/point_search.h"

#include "core/geometry/power_of_two.h"

namespace kdray::core {

SearchPoint MakeSearchPoint(const Vec3d& world, const MeshFrame& frame, const Bounds3d& bounds) {
  constexpr int kFarExponent = 24;
  constexpr double kFar = 0x1p24;
  SearchPoint point;
  point.at = frame.ToLocal(world);
  point.size = MaxAbs(point.at);
  if (point.size <= kFar) return point;
  const Vec3d moved = world - frame.origin;
  const int nearer = std::ilogb(MaxAbs(moved)) - frame.exponent - kFarExponent;
  for (int axis = 0; axis < 3; ++axis) {
    const double c = std::clamp(point.at[axis], bounds.min[axis], bounds.max[axis]);
    point.at[axis] = c * (1 - ScaleByPowerOfTwo(1, -nearer)) +
                     ScaleByPowerOfTwo(moved[axis], -frame.exponent - nearer);
  }
  point.size = MaxAbs(point.at);
  point.doubt = 0x1p-20;
  return point;
}

void ExactJudge::Begin(const SearchPoint& point, const Vec3d& world, double within) {
  exact_.emplace(world, mesh_->frame());
  at_ = point.at;
  error_ = kDistanceError * (point.size + 2) + point.doubt;
  distance_ = std::numeric_limits<double>::infinity();
  limit_ = within;
  id_ = kNoPrimitive;
}

bool ExactJudge::Offer(PrimitiveId id, CancelPoll* poll) {
  if (id == id_) return false;
  poll->Spend(kDistanceWork);
  const TriangleCorners corners = CornersOf(id);
  const double distance = std::sqrt(SquaredDistance(at_, corners[0], corners[1], corners[2]));
  if (distance > limit_) return false;
  if (id_ != kNoPrimitive && !(distance + error_ < distance_ - error_)) {
    if (distance - error_ > distance_ + error_) return false;
    poll->Spend(kCompareWork);
    const int order = exact_->Compare(corners, CornersOf(id_));
    if (order > 0 || (order == 0 && id > id_)) return false;
  }
  id_ = id;
  distance_ = distance;
  limit_ = std::min(limit_, distance + 3 * error_);
  return true;
}

}  // namespace kdray::core
