// Completes a caller's camera parameters to a camera that shows the mesh.
#pragma once

#include <optional>

#include "core/base/result.h"
#include "core/geometry/bounds3.h"
#include "core/render/camera.h"

namespace kdray::core {

/// The caller's parameters, world units. ResolveCamera chooses those that are missing.
struct CameraSpec {
  Projection projection = Projection::kPerspective;
  std::optional<Vec3d> eye = std::nullopt;
  std::optional<Vec3d> target = std::nullopt;
  std::optional<Vec3d> up = std::nullopt;
  std::optional<double> fov_deg =
      std::nullopt;  ///< vertical, in (0, 180); perspective only; default 40
  std::optional<double> view_height = std::nullopt;  ///< > 0, world units; orthographic only
};

inline constexpr double kDefaultFovDeg = 40;

/// Chooses the missing parameters so that all corners of the box `bounds` of the mesh are visible,
/// within the middle kFramedShare of the image. The rules for a missing value:
///   up           (0, 1, 0); when the view is along it, -z looking down and +z looking up.
///   target       the middle of the box; one step along the default view when the eye is there.
///   eye          before the target, 30 degrees right of the front and 20 degrees up, as near
///                as the box fits. Up is `up`. The smallest rotation that takes y to `up` takes +z
///                to the front (so the front is -y when z is up).
///   view_height  the least that shows the box around the axis from eye to target.
/// If eye and target are given, they are not changed; a perspective camera then may not show the
/// mesh.
///
/// kInvalidArgument with Error::field: a number that is not finite, eye equal to target, up zero or
/// along the view, fov_deg or view_height outside its range, a view too large for double. Otherwise
/// every number of the camera is finite, for flat and point-like boxes and for any box of float
/// range.
Result<Camera> ResolveCamera(const CameraSpec& spec, const Bounds3d& bounds, int width, int height);

inline constexpr double kFramedShare = 0.97;

}  // namespace kdray::core
