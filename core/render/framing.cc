#include "core/render/framing.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <string_view>
#include <utility>

namespace kdray::core {
namespace {

// Views closer to `up` than this (sine of the angle) have no steady image axes in double.
constexpr double kParallel = 1e-9;

constexpr double kFrontAzimuthDeg = 30;
constexpr double kFrontElevationDeg = 20;

double ToRadians(double degrees) { return degrees * (std::numbers::pi / 180.0); }

Error Invalid(std::string_view field, std::string message) {
  return Error{.code = ErrorCode::kInvalidArgument, .message = std::move(message), .field = field};
}

// The directions that the framing rules name.
struct Compass {
  Vec3d front, right, up;  // unit, orthogonal; front points from the mesh to a viewer before it

  explicit Compass(const Vec3d& unit_up) : up(unit_up) {
    // The smallest rotation that takes y to `up`, applied to +z.
    const double one_plus_y = 1.0 + up.y;
    front =
        one_plus_y > kParallel
            ? Normalized(Vec3d{-up.x * up.z / one_plus_y, -up.z, 1.0 - up.z * up.z / one_plus_y})
            : Vec3d{0, 0, -1};
    right = Cross(up, front);
  }

  // Unit vector from the mesh to the default eye.
  Vec3d TowardViewer() const {
    const double azimuth = ToRadians(kFrontAzimuthDeg);
    const double elevation = ToRadians(kFrontElevationDeg);
    return Normalized(front * (std::cos(elevation) * std::cos(azimuth)) +
                      right * (std::cos(elevation) * std::sin(azimuth)) + up * std::sin(elevation));
  }
};

// A reference length: the box's longest side, or, for a point, a fraction of its distance from 0
// that double resolves.
double SizeOf(const Bounds3d& bounds) {
  if (const double side = MaxAbs(bounds.Extent()); side > 0) return side;
  const double distance = MaxAbs(bounds.Center());
  return distance > 0 ? distance * 0x1p-10 : 1.0;
}

// A corner of the box seen from the middle of the view: x, y in the image plane, nearness toward
// the eye.
struct Corner {
  double x, y, nearness;
};

std::array<Corner, 8> CornersAround(const Bounds3d& bounds, const Vec3d& middle,
                                    const Camera& camera) {
  std::array<Corner, 8> corners;
  for (unsigned i = 0; i < corners.size(); ++i) {
    const Vec3d offset = bounds.Corner(i) - middle;
    corners[i] = {Dot(offset, camera.right), Dot(offset, camera.upward),
                  -Dot(offset, camera.forward)};
  }
  return corners;
}

// Step 1: checks the caller's numbers.
Status Check(const CameraSpec& spec) {
  if (spec.eye && !IsFinite(*spec.eye)) return Invalid("eye", "must be finite");
  if (spec.target && !IsFinite(*spec.target)) return Invalid("target", "must be finite");
  if (spec.up && !IsFinite(*spec.up)) return Invalid("up", "must be finite");
  if (spec.up && MaxAbs(*spec.up) == 0) return Invalid("up", "must not be zero");
  if (spec.fov_deg && !(*spec.fov_deg > 0 && *spec.fov_deg < 180)) {
    return Invalid("fov_deg", "must be above 0 and below 180");
  }
  if (spec.view_height && !(*spec.view_height > 0 && std::isfinite(*spec.view_height))) {
    return Invalid("view_height", "must be above 0");
  }
  if (spec.eye && spec.target) {
    if (*spec.eye == *spec.target) return Invalid("eye", "must differ from target");
    if (!IsFinite(*spec.target - *spec.eye)) return Invalid("eye", "too far from target");
  }
  return {};
}

// Step 2: the directions of the view, which do not depend on distances.
Status ChooseAxes(const CameraSpec& spec, const Bounds3d& bounds, Camera* camera) {
  const Vec3d up = NormalizedAtAnyScale(spec.up.value_or(Vec3d{0, 1, 0}));
  const Vec3d toward_viewer = Compass(up).TowardViewer();
  if (spec.eye) {
    Vec3d view = spec.target.value_or(bounds.Center()) - *spec.eye;
    if (!IsFinite(view)) return Invalid("eye", "too far from the mesh");
    camera->forward = MaxAbs(view) > 0 ? NormalizedAtAnyScale(view) : -toward_viewer;
  } else {
    camera->forward = -toward_viewer;
  }

  camera->up = spec.up.value_or(Vec3d{0, 1, 0});
  Vec3d right = Cross(camera->forward, up);
  if (!(Length(right) > kParallel)) {
    if (spec.up) return Invalid("up", "must not be parallel to the view from eye to target");
    camera->up = Vec3d{0, 0, camera->forward.y < 0 ? -1.0 : 1.0};
    right = Cross(camera->forward, camera->up);
  }
  camera->right = Normalized(right);
  camera->upward = Normalized(Cross(camera->right, camera->forward));
  return {};
}

// Step 3: the distance and the target.
void PlacePerspective(const CameraSpec& spec, const Bounds3d& bounds, Camera* camera) {
  if (spec.eye) {
    camera->eye = *spec.eye;
    return;
  }
  camera->target = spec.target.value_or(bounds.Center());
  const double slope_x = camera->half_width * kFramedShare;
  const double slope_y = camera->half_height * kFramedShare;
  double distance = 0;
  for (const Corner& c : CornersAround(bounds, camera->target, *camera)) {
    // A corner is inside if |x| <= slope_x * (distance - nearness), and likewise for y. The last
    // term keeps a box without width and height in the image away from the eye.
    distance =
        std::max({distance, std::abs(c.x) / slope_x + c.nearness,
                  std::abs(c.y) / slope_y + c.nearness, c.nearness + SizeOf(bounds) * 0x1p-10});
  }
  camera->eye = camera->target - camera->forward * distance;
}

void PlaceOrthographic(const CameraSpec& spec, const Bounds3d& bounds, Camera* camera) {
  const double size = SizeOf(bounds);
  if (spec.eye) {
    camera->eye = *spec.eye;
  } else {
    camera->target = spec.target.value_or(bounds.Center());
    double nearest = 0;
    for (const Corner& corner : CornersAround(bounds, camera->target, *camera)) {
      nearest = std::max(nearest, corner.nearness);
    }
    camera->eye = camera->target - camera->forward * (nearest + size);
  }
  if (spec.view_height) {
    camera->view_height = *spec.view_height;
  } else {
    const double aspect = static_cast<double>(camera->width) / camera->height;
    double half_height = 0;
    for (const Corner& corner : CornersAround(bounds, camera->eye, *camera)) {
      half_height = std::max({half_height, std::abs(corner.y), std::abs(corner.x) / aspect});
    }
    camera->view_height = half_height > 0 ? 2 * half_height / kFramedShare : size;
  }
  camera->half_height = camera->view_height / 2;
  camera->half_width = camera->half_height * camera->width / camera->height;
}

}  // namespace

Result<Camera> ResolveCamera(const CameraSpec& spec, const Bounds3d& bounds, int width,
                             int height) {
  assert(!bounds.IsEmpty() && width > 0 && height > 0);
  if (Status status = Check(spec); !status.ok()) return std::move(status).error();

  Camera camera;
  camera.projection = spec.projection;
  camera.width = width;
  camera.height = height;
  if (Status status = ChooseAxes(spec, bounds, &camera); !status.ok()) {
    return std::move(status).error();
  }

  if (spec.projection == Projection::kPerspective) {
    camera.fov_deg = spec.fov_deg.value_or(kDefaultFovDeg);
    camera.half_height = std::tan(ToRadians(camera.fov_deg) / 2);
    camera.half_width = camera.half_height * width / height;
    PlacePerspective(spec, bounds, &camera);
  } else {
    PlaceOrthographic(spec, bounds, &camera);
  }
  if (spec.eye) {
    camera.target = spec.target.value_or(bounds.Center());
    if (camera.target == camera.eye) camera.target = camera.eye + camera.forward * SizeOf(bounds);
  }
  if (!IsFinite(camera.eye) || !IsFinite(camera.target) || !std::isfinite(camera.half_width) ||
      !std::isfinite(camera.half_height)) {
    return Invalid("eye", "the view is too large for the numbers that describe it");
  }
  return camera;
}

}  // namespace kdray::core
