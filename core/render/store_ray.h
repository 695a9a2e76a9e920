// SPDX-License-Identifier: Apache-2.0
// How loops over many rays write them.
#pragma once

#include "core/geometry/ray.h"

namespace kdray::core {

/// *to = ray, number by number. A ray that was just computed and is copied as a whole is read from
/// the stack in loads that are wider than the stores before, and must wait until these are done,
/// which takes longer than everything else.
inline void StoreRay(const Ray& ray, Ray* to) {
  to->origin.x = ray.origin.x;
  to->origin.y = ray.origin.y;
  to->origin.z = ray.origin.z;
  to->t_min = ray.t_min;
  to->direction.x = ray.direction.x;
  to->direction.y = ray.direction.y;
  to->direction.z = ray.direction.z;
  to->t_max = ray.t_max;
}

}  // namespace kdray::core
