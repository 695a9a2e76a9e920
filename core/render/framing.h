// SPDX-License-Identifier: Apache-2.0
// Completes a caller's camera parameters to a camera that shows the mesh.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "core/base/result.h"
#include "core/geometry/bounds3.h"
#include "core/render/camera.h"

namespace kdray::core {

/// The side of the mesh that a camera stands on, by the compass of `up` (ResolveCamera).
enum class View : std::uint8_t { kIso, kFront, kBack, kLeft, kRight, kTop, kBottom };

/// Pinhole intrinsics, pixels: image point (x, y) is seen along ((x - cx) / fx, (y - cy) / fy, 1)
/// in axes right, down, forward.
struct Intrinsics {
  double fx = 1, fy = 1;  ///< > 0
  double cx = 0, cy = 0;
};

/// World to camera, row by row; the camera's axes are right, down, forward.
using Extrinsics = std::array<double, 16>;

/// The caller's parameters, world units. ResolveCamera chooses those that are missing.
struct CameraSpec {
  Projection projection = Projection::kPerspective;
  std::optional<Vec3d> eye = std::nullopt;
  std::optional<Vec3d> target = std::nullopt;
  std::optional<Vec3d> up = std::nullopt;
  std::optional<View> view = std::nullopt;  ///< chooses the direction of a missing eye
  std::optional<double> fov_deg =
      std::nullopt;  ///< vertical, in (0, 180); perspective only; default 40
  std::optional<double> view_height = std::nullopt;    ///< > 0, world units; orthographic only
  std::optional<double> h_fov_deg = std::nullopt;      ///< in (0, 360]; spherical only; default 360
  std::optional<double> v_fov_deg = std::nullopt;      ///< in (0, 180]; spherical only; default 180
  std::optional<Intrinsics> intrinsic = std::nullopt;  ///< perspective only; replaces fov_deg
  std::optional<Extrinsics> extrinsic =
      std::nullopt;  ///< perspective only; replaces eye, target, up and view
};

inline constexpr double kDefaultFovDeg = 40;

/// Chooses the missing parameters so that all corners of the box `bounds` of the mesh are visible,
/// within the middle kFramedShare of the image. The rules for a missing value:
///   up           (0, 1, 0); when the view is along it, -z looking down and +z looking up.
///   target       the middle of the box; one step along the default view when the eye is there.
///   eye          on the side `view` of the target, which appears in the middle of the image, as
///                near as the box fits. Up is `up`. The smallest rotation that takes y to `up`
///                takes +z to the front (so the front is -y when z is up), and the right is up x
///                front. iso is at equal angles to front, right and up. A view from the top or
///                bottom has the front at the lower or upper edge of the image. Without `view`: 30
///                degrees right of the front and 20 degrees up. Spherical: the middle of the box.
///   view_height  the least that shows the box around the axis from eye to target.
/// If eye and target are given, they are not changed; a perspective camera then may not show the
/// mesh.
///
/// A spherical camera looks from the eye in all directions: `right` is view x up, elevations are
/// above the plane that is perpendicular to up, and middle_elevation is that of the view, moved so
/// that all rows stay within +-90 degrees.
///
/// kInvalidArgument with Error::field: a number that is not finite, eye equal to target, up zero or
/// along the view, fov_deg, view_height, h_fov_deg, v_fov_deg, fx or fy outside its range, an
/// extrinsic that is not a rotation (orthonormal within 1e-6) and a translation, a view too large
/// for double. Otherwise every number of the camera is finite, for flat and point-like boxes and
/// for any box of float range.
Result<Camera> ResolveCamera(const CameraSpec& spec, const Bounds3d& bounds, int width, int height);

inline constexpr double kFramedShare = 0.97;

}  // namespace kdray::core
