// A camera in world units: rays from pixels, and points to pixels. core/render/framing.h makes one
// from a caller's parameters.
#pragma once

#include <cstdint>

#include "core/geometry/ray.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

enum class Projection : std::uint8_t { kPerspective, kOrthographic };

/// Right-handed: right x upward = -forward. Pixels are square; image coordinates run from (0, 0),
/// the top left corner of the image, to (width, height), so the centre of pixel (i, j) is
/// (i + 0.5, j + 0.5). Immutable in use, so safe from many threads at once.
struct Camera {
  Projection projection = Projection::kPerspective;
  int width = 1, height = 1;  ///< of the whole image, pixels

  // As given by the caller, or chosen by ResolveCamera.
  Vec3d eye, target, up;
  double fov_deg = 0;      ///< perspective: vertical angle of view
  double view_height = 0;  ///< orthographic: height of the view, world units

  Vec3d right, upward, forward;  ///< orthonormal: the image's x axis, its y axis upside down, and
                                 ///< the view axis
  double half_width = 0;         ///< half the image at depth 1 (perspective), in world units
  double half_height = 0;        ///< (orthographic)

  /// The ray through a point of the image. Its direction's component along the view axis is 1, so
  /// t is the depth: the distance from the eye along the view axis, in world units.
  Ray RayThrough(double x_px, double y_px) const {
    const double x = (2.0 * x_px / width - 1.0) * half_width;
    const double y = (1.0 - 2.0 * y_px / height) * half_height;
    const Vec3d offset = right * x + upward * y;
    Ray ray;
    if (projection == Projection::kPerspective) {
      ray.origin = eye;
      ray.direction = forward + offset;
    } else {
      ray.origin = eye + offset;
      ray.direction = forward;
    }
    return ray;
  }

  /// A point in the camera's frame, before the division by depth.
  struct ViewPoint {
    double x = 0, y = 0;  ///< along right and upward, world units
    double depth = 0;     ///< along forward
  };
  ViewPoint ToView(const Vec3d& point) const {
    const Vec3d from_eye = point - eye;
    return {Dot(from_eye, right), Dot(from_eye, upward), Dot(from_eye, forward)};
  }

  struct ImagePoint {
    double x_px = 0, y_px = 0;
  };
  /// Where a point with depth > 0 appears.
  ImagePoint ToImage(const ViewPoint& point) const {
    const double scale = projection == Projection::kPerspective ? point.depth : 1.0;
    return {(point.x / (scale * half_width) + 1.0) * 0.5 * width,
            (1.0 - point.y / (scale * half_height)) * 0.5 * height};
  }

  /// Side of a pixel's footprint at `depth`, world units.
  double PixelSize(double depth) const {
    const double scale = projection == Projection::kPerspective ? depth : 1.0;
    return 2.0 * half_height * scale / height;
  }
};

}  // namespace kdray::core
