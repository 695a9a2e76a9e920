// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kdtree/split.h"

namespace kdray::core {

SplitProbability::SplitProbability(const Bounds3f& cell, int axis)
    : low_(static_cast<double>(cell.min[axis])), high_(static_cast<double>(cell.max[axis])) {
  // In double, because in float the area of a tiny cell would underflow.
  const Bounds3d box{Vec3d(cell.min), Vec3d(cell.max)};
  const double area = box.SurfaceArea();
  if (!(area > 0)) return;
  const Vec3d extent = box.Extent();
  const double b = extent[(axis + 1) % 3];
  const double c = extent[(axis + 2) % 3];
  base_ = 2 * b * c / area;
  slope_ = 2 * (b + c) / area;
  valid_ = true;
}

}  // namespace kdray::core
