// Rays through many points of one image, cheaper than Camera::RayThrough for each.
#pragma once

#include "core/geometry/ray.h"
#include "core/render/camera.h"

namespace kdray::core {

/// In these projections a ray is linear in its point of the image, so two products give it. Equal
/// to Camera::RayThrough up to rounding; the same numbers for every region. Immutable, so safe from
/// many threads at once.
class CameraRays {
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
  }

  const Camera& camera() const { return camera_; }

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

 private:
  // The change of a ray per pixel.
  struct Step {
    Vec3d origin, direction;
  };

  Camera camera_;
  bool is_linear_;
  Ray corner_;
  Step x_, y_;
};

}  // namespace kdray::core
