// SPDX-License-Identifier: Apache-2.0
// Rays through many points of one image, cheaper than Camera::RayThrough for each.
#pragma once

#include <algorithm>
#include <limits>

#include "core/geometry/bounds3.h"
#include "core/geometry/ray.h"
#include "core/render/camera.h"
#include "core/render/four.h"

namespace kdray::core {

/// In these projections a ray is linear in its point of the image, so two products give it. Equal
/// to Camera::RayThrough up to rounding; the same numbers for every region. Immutable, so safe from
/// many threads at once.
class CameraRays {
  // Half a ray: origin and t_min, or direction and t_max.
  using Four = FourFloats;
  static Four Widened(const Vec3f& v, float fourth) { return Four{v.x, v.y, v.z, fourth}; }

 public:
  explicit CameraRays(const Camera& camera)
      : camera_(camera),
        is_linear_(camera.projection == Projection::kPerspective ||
                   camera.projection == Projection::kOrthographic),
        corner_(camera.RayThrough(0, 0)) {
    if (!is_linear_) return;
    const Ray right = camera.RayThrough(camera.width, 0);
    const Ray below = camera.RayThrough(0, camera.height);
    const double per_x = 1.0 / camera.width;
    const double per_y = 1.0 / camera.height;
    x_ = {(right.origin - corner_.origin) * per_x, (right.direction - corner_.direction) * per_x};
    y_ = {(below.origin - corner_.origin) * per_y, (below.direction - corner_.direction) * per_y};
    from_in_float_ = Widened(Vec3f(camera.eye), 0);
    x_in_float_ = Widened(Vec3f(x_.direction), 0);
    y_in_float_ = Widened(Vec3f(y_.direction), 0);
  }

  const Camera& camera() const { return camera_; }

  /// Whether rays in single precision show the same: the eye is off by less than 2^-20 of the mesh,
  /// and a direction by less than a hundredth of a pixel. Perspective only. Depends only on mesh
  /// and camera, so all regions of an image agree.
  bool FitFloat(const Bounds3d& bounds) const {
    if (camera_.projection != Projection::kPerspective) return false;
    const Vec3d moved = Vec3d(Vec3f(camera_.eye)) - camera_.eye;
    if (!(MaxAbs(moved) <= 0x1p-20 * MaxAbs(bounds.Extent()))) return false;
    const double pixel = std::min(MaxAbs(x_.direction), MaxAbs(y_.direction));
    double largest = 0;
    for (const double x : {0.0, 1.0 * camera_.width}) {
      for (const double y : {0.0, 1.0 * camera_.height}) {
        largest = std::max(largest, MaxAbs(camera_.RayThrough(x, y).direction));
      }
    }
    // Three roundings, each to 2^-24 of the largest component.
    return 0x1p-22 * largest <= 0.01 * pixel && largest <= 0x1p20;
  }

  /// Rays near one point, by their distance from it.
  class Around {
   public:
    Around(const CameraRays& rays, double x_px, double y_px)
        : rays_(rays), x_px_(x_px), y_px_(y_px), ray_(rays.corner_) {
      if (!rays.is_linear_) return;
      ray_.origin = ray_.origin + rays.x_.origin * x_px + rays.y_.origin * y_px;
      ray_.direction = ray_.direction + rays.x_.direction * x_px + rays.y_.direction * y_px;
    }
    Ray At(double dx_px, double dy_px) const {
      if (!rays_.is_linear_) return rays_.camera_.RayThrough(x_px_ + dx_px, y_px_ + dy_px);
      Ray ray = ray_;
      ray.direction = ray.direction + rays_.x_.direction * dx_px + rays_.y_.direction * dy_px;
      if (rays_.camera_.projection == Projection::kOrthographic) {
        ray.origin = ray.origin + rays_.x_.origin * dx_px + rays_.y_.origin * dy_px;
      }
      return ray;
    }

   private:
    const CameraRays& rays_;
    double x_px_, y_px_;
    Ray ray_;
  };

  /// The same in single precision, if FitFloat.
  class AroundInFloat {
   public:
    AroundInFloat(const CameraRays& rays, double x_px, double y_px)
        : from_(rays.from_in_float_),
          to_(Widened(
              Vec3f(rays.corner_.direction + rays.x_.direction * x_px + rays.y_.direction * y_px),
              std::numeric_limits<float>::infinity())),
          x_(rays.x_in_float_),
          y_(rays.y_in_float_) {}
    void Write(float dx_px, float dy_px, RayF* ray) const {
      const Four to = to_ + x_ * dx_px + y_ * dy_px;
      __builtin_memcpy(static_cast<void*>(&ray->origin), &from_, sizeof(from_));
      __builtin_memcpy(static_cast<void*>(&ray->direction), &to, sizeof(to));
    }

   private:
    Four from_, to_, x_, y_;
  };

 private:
  // The change of a ray per pixel.
  struct Step {
    Vec3d origin, direction;
  };

  Camera camera_;
  bool is_linear_;
  Ray corner_;
  Step x_, y_;
  Four from_in_float_ = {}, x_in_float_ = {}, y_in_float_ = {};
};

}  // namespace kdray::core
