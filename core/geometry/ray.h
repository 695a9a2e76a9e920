// SPDX-License-Identifier: Apache-2.0
// Rays as callers give them, in mesh units.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <variant>

#include "core/geometry/vec3.h"

namespace kdray::core {

/// The points origin + t * direction with t_min <= t <= t_max, both ends included. The direction
/// need not be unit; t counts its lengths. t_max may be infinite.
template <class T>
struct RayOf {
  Vec3<T> origin;
  T t_min = 0;
  Vec3<T> direction;
  T t_max = std::numeric_limits<T>::infinity();
};
using Ray = RayOf<double>;  // 64 bytes
using RayF =
    RayOf<float>;  // 32 bytes: the same ray in half the memory when its numbers are floats anyway
static_assert(sizeof(Ray) == 64 && sizeof(RayF) == 32);

/// False for an invalid ray: an origin or direction that is not finite, t_min or t_max NaN, a zero
/// direction, t_min > t_max. Such a row of a batch is a miss and is named in the answer.
template <class T>
bool IsValid(const RayOf<T>& ray) {
  const auto& [o, t_min, d, t_max] = ray;
  // Without a branch: a finite number minus itself is 0, and any other is NaN.
  const T zero =
      ((o.x - o.x) + (o.y - o.y) + (o.z - o.z)) + ((d.x - d.x) + (d.y - d.y) + (d.z - d.z));
  return (zero == 0) & (t_min <= t_max) & ((d.x != 0) | (d.y != 0) | (d.z != 0));
}

/// A view of a batch of rays, single or double. A float ray means exactly the double ray of the
/// same numbers, so the two forms give the same answers.
class RayBatch {
 public:
  RayBatch(std::span<const Ray> rays) : rays_(rays) {}   // NOLINT(google-explicit-constructor)
  RayBatch(std::span<const RayF> rays) : rays_(rays) {}  // NOLINT(google-explicit-constructor)

  std::size_t size() const {
    return std::visit([](const auto& rays) { return rays.size(); }, rays_);
  }
  Ray operator[](std::size_t i) const {
    if (const auto* rays = std::get_if<std::span<const Ray>>(&rays_)) return (*rays)[i];
    const RayF& r = std::get<std::span<const RayF>>(rays_)[i];
    return Ray{Vec3d(r.origin), static_cast<double>(r.t_min), Vec3d(r.direction),
               static_cast<double>(r.t_max)};
  }
  /// The first ray; null if the rays are of the other type.
  const Ray* doubles() const {
    const auto* rays = std::get_if<std::span<const Ray>>(&rays_);
    return rays != nullptr ? rays->data() : nullptr;
  }
  const RayF* floats() const {
    const auto* rays = std::get_if<std::span<const RayF>>(&rays_);
    return rays != nullptr ? rays->data() : nullptr;
  }

  /// Prefetches a ray that is needed soon.
  void Prefetch(std::size_t i) const {
    std::visit([&](const auto& rays) { __builtin_prefetch(&rays[i]); }, rays_);
  }

 private:
  std::variant<std::span<const Ray>, std::span<const RayF>> rays_;
};

}  // namespace kdray::core
