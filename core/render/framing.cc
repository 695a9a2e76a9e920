// SPDX-License-Identifier: Apache-2.0
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

// Largest error of a product of two rows of a rotation that a caller sends.
constexpr double kOrthonormal = 1e-6;

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

  // Unit vector from the mesh to the eye.
  Vec3d TowardViewer(std::optional<View> view) const {
    if (!view) return TowardDefaultViewer();
    switch (*view) {
      case View::kIso:
        return Normalized(front + right + up);
      case View::kFront:
        return front;
      case View::kBack:
        return -front;
      case View::kLeft:
        return -right;
      case View::kRight:
        return right;
      case View::kTop:
        return up;
      case View::kBottom:
        break;
    }
    return -up;
  }
  Vec3d TowardDefaultViewer() const {
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
  if (spec.h_fov_deg && !(*spec.h_fov_deg > 0 && *spec.h_fov_deg <= 360)) {
    return Invalid("h_fov_deg", "must be above 0 and at most 360");
  }
  if (spec.v_fov_deg && !(*spec.v_fov_deg > 0 && *spec.v_fov_deg <= 180)) {
    return Invalid("v_fov_deg", "must be above 0 and at most 180");
  }
  if (const auto& k = spec.intrinsic) {
    if (!(k->fx > 0 && k->fy > 0)) return Invalid("intrinsic", "fx and fy must be above 0");
    if (!std::isfinite(k->fx + k->fy + k->cx + k->cy)) {
      return Invalid("intrinsic", "must be finite");
    }
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
  const Compass compass(up);
  camera->forward = -compass.TowardViewer(spec.view);
  const bool from_middle = spec.projection == Projection::kSpherical && !spec.view;
  if (spec.eye || from_middle) {
    const Vec3d view = spec.target.value_or(bounds.Center()) - spec.eye.value_or(bounds.Center());
    if (!IsFinite(view)) return Invalid(spec.eye ? "eye" : "target", "too far from the mesh");
    if (MaxAbs(view) > 0) camera->forward = NormalizedAtAnyScale(view);
  }

  camera->up = spec.up.value_or(Vec3d{0, 1, 0});
  Vec3d right = Cross(camera->forward, up);
  if (!(Length(right) > kParallel)) {
    const bool is_down = Dot(camera->forward, up) < 0;
    if (spec.up && (!spec.view || spec.projection == Projection::kSpherical)) {
      return Invalid("up", "must not be parallel to the view");
    }
    camera->up = is_down ? -compass.front : compass.front;
    right = Cross(camera->forward, camera->up);
  }
  camera->right = Normalized(right);
  camera->upward = Normalized(Cross(camera->right, camera->forward));
  return {};
}

// Step 3: the distance and the target.
void PlacePerspective(const CameraSpec& spec, const Bounds3d& bounds, Camera* camera) {
  if (spec.intrinsic) {
    camera->pixel_width = 1 / spec.intrinsic->fx;
    camera->pixel_height = 1 / spec.intrinsic->fy;
    camera->center_x_px = spec.intrinsic->cx;
    camera->center_y_px = spec.intrinsic->cy;
  } else {
    camera->fov_deg = spec.fov_deg.value_or(kDefaultFovDeg);
    camera->pixel_height = 2 * std::tan(ToRadians(camera->fov_deg) / 2) / camera->height;
    camera->pixel_width = camera->pixel_height;
  }
  if (spec.extrinsic) return;
  if (spec.eye) {
    camera->eye = *spec.eye;
    return;
  }
  camera->target = spec.target.value_or(bounds.Center());
  // The middle of the image at depth 1, and how far from it the box may reach.
  const double middle_x = (camera->width / 2.0 - camera->center_x_px) * camera->pixel_width;
  const double middle_y = (camera->center_y_px - camera->height / 2.0) * camera->pixel_height;
  const double slope_x = camera->width * camera->pixel_width / 2 * kFramedShare;
  const double slope_y = camera->height * camera->pixel_height / 2 * kFramedShare;
  double distance = 0;
  for (const Corner& c : CornersAround(bounds, camera->target, *camera)) {
    // The corner's depth is distance - nearness. It is inside if its distance from the middle,
    // |x + middle_x * nearness|, is at most slope_x * depth, and likewise for y. The last term
    // keeps a box without width and height in the image away from the eye.
    distance = std::max({distance, std::abs(c.x + middle_x * c.nearness) / slope_x + c.nearness,
                         std::abs(c.y + middle_y * c.nearness) / slope_y + c.nearness,
                         c.nearness + SizeOf(bounds) * 0x1p-10});
  }
  const Vec3d to_middle = camera->forward + camera->right * middle_x + camera->upward * middle_y;
  camera->eye = camera->target - to_middle * distance;
}

// Works on the inverse of the matrix, as other programs do: a matrix that is only nearly
// orthonormal then gives the same rays there and here.
Status PlaceByMatrix(const Extrinsics& m, const Bounds3d& bounds, Camera* camera) {
  for (const double number : m) {
    if (!std::isfinite(number)) return Invalid("extrinsic", "must be finite");
  }
  if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1) {
    return Invalid("extrinsic", "the last row must be 0, 0, 0, 1");
  }
  const std::array<Vec3d, 3> rows = {Vec3d{m[0], m[1], m[2]}, Vec3d{m[4], m[5], m[6]},
                                     Vec3d{m[8], m[9], m[10]}};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = i; j < 3; ++j) {
      const double expected = i == j ? 1.0 : 0.0;
      if (!(std::abs(Dot(rows[i], rows[j]) - expected) <= kOrthonormal)) {
        return Invalid("extrinsic", "rows 1 to 3 must begin with a rotation: row " +
                                        std::to_string(i + 1) + " times row " +
                                        std::to_string(j + 1) + " must be " +
                                        std::to_string(i == j ? 1 : 0) + " within 1e-6");
      }
    }
  }
  const double determinant = Dot(rows[0], Cross(rows[1], rows[2]));
  if (!(determinant > 0)) {
    return Invalid("extrinsic", "rows 1 to 3 must begin with a rotation: the determinant is -1");
  }
  const double scale = 1 / determinant;
  camera->right = Cross(rows[1], rows[2]) * scale;
  camera->upward = Cross(rows[2], rows[0]) * -scale;
  camera->forward = Cross(rows[0], rows[1]) * scale;
  camera->eye = camera->upward * m[7] - camera->right * m[3] - camera->forward * m[11];
  camera->target = camera->eye + camera->forward * SizeOf(bounds);
  camera->up = camera->upward;
  return {};
}

void PlaceSpherical(const CameraSpec& spec, const Bounds3d& bounds, Camera* camera) {
  camera->eye = spec.eye.value_or(bounds.Center());
  camera->target = spec.target.value_or(bounds.Center());
  camera->h_fov = ToRadians(spec.h_fov_deg.value_or(360));
  camera->v_fov = ToRadians(spec.v_fov_deg.value_or(180));
  const Vec3d view = camera->forward;
  camera->upward = NormalizedAtAnyScale(camera->up);
  camera->forward = Normalized(Cross(camera->upward, camera->right));
  const double highest = std::max(std::numbers::pi / 2 - camera->v_fov / 2, 0.0);
  const double elevation = std::atan2(Dot(view, camera->upward), Dot(view, camera->forward));
  camera->middle_elevation = std::clamp(elevation, -highest, highest);
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
  camera->pixel_height = camera->view_height / camera->height;
  camera->pixel_width = camera->pixel_height;
}

// The parameter that makes a view too large: of those that the caller gave, the largest.
std::string_view LargestParameter(const CameraSpec& spec) {
  if (spec.intrinsic) return "intrinsic";
  std::string_view field = "fov_deg";  // a small one moves the eye away
  double largest = 0;
  const auto see = [&](std::string_view name, double size) {
    if (!(size > largest)) return;
    largest = size;
    field = name;
  };
  if (spec.eye) see("eye", MaxAbs(*spec.eye));
  if (spec.target) see("target", MaxAbs(*spec.target));
  if (spec.view_height) see("view_height", *spec.view_height);
  return field;
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
  camera.center_x_px = width / 2.0;
  camera.center_y_px = height / 2.0;
  const bool by_matrix = spec.extrinsic && spec.projection == Projection::kPerspective;
  Status axes = by_matrix ? PlaceByMatrix(*spec.extrinsic, bounds, &camera)
                          : ChooseAxes(spec, bounds, &camera);
  if (!axes.ok()) return std::move(axes).error();

  switch (spec.projection) {
    case Projection::kPerspective:
      PlacePerspective(spec, bounds, &camera);
      break;
    case Projection::kOrthographic:
      PlaceOrthographic(spec, bounds, &camera);
      break;
    case Projection::kSpherical:
      PlaceSpherical(spec, bounds, &camera);
      break;
  }
  if (spec.eye && !by_matrix) {
    camera.target = spec.target.value_or(bounds.Center());
    if (camera.target == camera.eye) camera.target = camera.eye + camera.forward * SizeOf(bounds);
  }
  const double reach_x = (width + std::abs(camera.center_x_px)) * camera.pixel_width;
  const double reach_y = (height + std::abs(camera.center_y_px)) * camera.pixel_height;
  if (!IsFinite(camera.eye) || !IsFinite(camera.target) || !std::isfinite(reach_x) ||
      !std::isfinite(reach_y)) {
    return Invalid(by_matrix ? "extrinsic" : LargestParameter(spec),
                   "the view is too large for the numbers that describe it");
  }
  return camera;
}

}  // namespace kdray::core
