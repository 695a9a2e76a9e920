// From what a caller says about the camera, with gaps, to a whole camera that shows the mesh.
#pragma once

#include <optional>

#include "core/base/result.h"
#include "core/geometry/bounds3.h"
#include "core/render/camera.h"

namespace kdray::core {

/// The caller's wishes, world units. What is left out is chosen by ResolveCamera.
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

/// Fills the gaps so that the box `bounds` of the mesh is framed: all its corners are seen, within
/// the middle kFramedShare of the image. The rules, each for a value left out:
///   up           (0, 1, 0); when the view is along it, -z looking down and +z looking up.
///   target       the middle of the box; one step along the default view when the eye is there.
///   eye          before the target, 30 degrees to the right of the front and 20 degrees up, as
///   near
///                as the box fits. Up is `up`; front is the side that the smallest rotation taking
///                y to `up` makes of +z (so -y when z is up).
///   view_height  the least that shows the box around the axis from eye to target.
/// With eye and target given nothing is moved: a perspective camera need not see the mesh then.
///
/// kInvalidArgument, with the field's name first: a number that is not finite, eye equal to target,
/// up zero or along the view, fov_deg or view_height outside its range, a view too large for
/// double. Otherwise every number of the camera is finite, for flat and point-like boxes and for
/// any box of float range.
Result<Camera> ResolveCamera(const CameraSpec& spec, const Bounds3d& bounds, int width, int height);

inline constexpr double kFramedShare = 0.97;

}  // namespace kdray::core
