// SPDX-License-Identifier: Apache-2.0
// A camera in world units: rays from pixels, and points to pixels. core/render/framing.h makes one
// from a caller's parameters.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/geometry/ray.h"
#include "core/geometry/vec3.h"

namespace kdray::core {

enum class Projection : std::uint8_t { kPerspective, kOrthographic, kSpherical };

/// Right-handed: right x upward = -forward. Image coordinates run from (0, 0), the top left corner
/// of the image, to (width, height), so the centre of pixel (i, j) is (i + 0.5, j + 0.5). Immutable
/// in use, so safe from many threads at once.
struct Camera {
  Projection projection = Projection::kPerspective;
  int width = 1, height = 1;  ///< of the whole image, pixels

  // As given by the caller, or chosen by ResolveCamera.
  Vec3d eye, target, up;
  double fov_deg = 0;      ///< perspective without intrinsics: vertical angle of view
  double view_height = 0;  ///< orthographic: height of the view, world units

  /// Orthonormal: the image's x axis, its y axis upside down, and the view axis. With a caller's
  /// matrix as nearly orthonormal as the matrix. Spherical: upward is `up`, and forward is the
  /// direction of azimuth 0 and elevation 0.
  Vec3d right, upward, forward;

  // Perspective and orthographic.
  double center_x_px = 0, center_y_px = 0;   ///< where the view axis meets the image
  double pixel_width = 0, pixel_height = 0;  ///< of a pixel at depth 1 (perspective), or anywhere
                                             ///< (orthographic), world units

  // Spherical, radians.
  double h_fov = 0, v_fov = 0;  ///< of the whole image
  double middle_elevation = 0;  ///< of the image's middle row

  /// The part of a ray that depends only on the column of its point in the image.
  struct Column {
    Vec3d offset;                 ///< along `right`, world units; spherical: not used
    double cosine = 0, sine = 0;  ///< spherical: of the azimuth
  };
  /// The part that depends only on the row.
  struct Row {
    Vec3d offset;      ///< along `upward`, world units; spherical: of the direction
    double level = 0;  ///< spherical: the cosine of the elevation
  };
  Column ColumnAt(double x_px) const {
    if (projection == Projection::kSpherical) {
      const double azimuth = AzimuthAt(x_px);
      return {{}, std::cos(azimuth), std::sin(azimuth)};
    }
    return {.offset = right * ((x_px - center_x_px) * pixel_width)};
  }
  Row RowAt(double y_px) const {
    if (projection == Projection::kSpherical) {
      const double elevation = ElevationAt(y_px);
      return {upward * std::sin(elevation), std::cos(elevation)};
    }
    return {.offset = upward * ((center_y_px - y_px) * pixel_height)};
  }

  /// The ray through a point of the image. t is the depth in world units: the distance from the eye
  /// along the view axis, because the direction's component along it is 1; spherical: the distance
  /// along the ray, because the direction is unit.
  Ray RayThrough(double x_px, double y_px) const { return RayThrough(ColumnAt(x_px), RowAt(y_px)); }
  /// The same, bit for bit, where the parts are used for many rays.
  Ray RayThrough(const Column& column, const Row& row) const {
    Ray ray;
    ray.origin = eye;
    if (projection == Projection::kSpherical) {
      ray.direction =
          forward * (row.level * column.cosine) + right * (row.level * column.sine) + row.offset;
      return ray;
    }
    const Vec3d offset = column.offset + row.offset;
    if (projection == Projection::kPerspective) {
      ray.direction = forward + offset;
    } else {
      ray.origin = eye + offset;
      ray.direction = forward;
    }
    return ray;
  }

  /// Side of a pixel's footprint at `depth`, world units; the smaller one where sides differ.
  double PixelSize(double depth) const {
    if (projection == Projection::kSpherical) {
      return std::min(h_fov / width, v_fov / height) * depth;
    }
    return std::min(pixel_width, pixel_height) *
           (projection == Projection::kPerspective ? depth : 1.0);
  }

  // ---- Points to pixels: perspective and orthographic ----

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
    return {center_x_px + point.x / (scale * pixel_width),
            center_y_px - point.y / (scale * pixel_height)};
  }

  /// A camera whose ToView and ToImage agree with the image near a point of it: this one, or for a
  /// spherical camera the perspective one whose image touches the sphere there. Its depth at the
  /// point is that of this camera.
  Camera FlatAt(double x_px, double y_px) const {
    if (projection != Projection::kSpherical) return *this;
    const double azimuth = AzimuthAt(x_px);
    const double elevation = ElevationAt(y_px);
    const double level = std::cos(elevation);
    const Vec3d ahead = forward * std::cos(azimuth) + right * std::sin(azimuth);
    Camera flat = *this;
    flat.projection = Projection::kPerspective;
    flat.forward = ahead * level + upward * std::sin(elevation);
    flat.right = right * std::cos(azimuth) - forward * std::sin(azimuth);
    flat.upward = upward * level - ahead * std::sin(elevation);
    flat.center_x_px = x_px;
    flat.center_y_px = y_px;
    flat.pixel_width = h_fov / width * level;
    flat.pixel_height = v_fov / height;
    return flat;
  }

 private:
  // Radians.
  double AzimuthAt(double x_px) const { return (x_px / width - 0.5) * h_fov; }
  double ElevationAt(double y_px) const { return middle_elevation + (0.5 - y_px / height) * v_fov; }
};

}  // namespace kdray::core
