#include "server/hit_details.h"

#include <limits>

#include "core/intersect/hit_filter.h"
#include "core/render/shading.h"

namespace kdray::server {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr api::Vec3 kNoVector = {kNaN, kNaN, kNaN};

api::Vec3 ToVec(const core::Vec3d& v) { return {v.x, v.y, v.z}; }

/// The triangle's point with the weights u and v.
core::Vec3d PointOf(const core::TriangleMesh& mesh, const core::Hit& hit) {
  const core::Vec3d a = mesh.LocalCorner(hit.primitive_id, 0);
  const core::Vec3d b = mesh.LocalCorner(hit.primitive_id, 1);
  const core::Vec3d c = mesh.LocalCorner(hit.primitive_id, 2);
  return mesh.frame().ToWorld(a * (1 - hit.u - hit.v) + b * hit.u + c * hit.v);
}

}  // namespace

bool HitDetails::HasDetails(const api::RayOptions& options) {
  using enum api::RayField;
  return options.Names(kNormal) || options.Names(kPoint) || options.Names(kSide);
}

void HitDetails::Begin(std::size_t count) {
  using enum api::RayField;
  hits_.resize(count);
  if (options_.Names(kNormal)) normals_.assign(count, kNoVector);
  if (options_.Names(kPoint)) points_.assign(count, kNoVector);
  if (options_.Names(kSide)) sides_.assign(count, 0);
}

void HitDetails::FillHit(std::size_t i, const core::Ray& ray, const core::Hit& hit) {
  const core::TriangleMesh& mesh = *scene_.mesh;
  if (!normals_.empty()) normals_[i] = ToVec(core::UnitNormal(mesh, hit.primitive_id));
  if (!points_.empty()) points_[i] = ToVec(PointOf(mesh, hit));
  if (!sides_.empty()) {
    sides_[i] = static_cast<std::int8_t>(core::SideMet(mesh, ray, hit.primitive_id));
  }
}

api::Hits HitDetails::View() const {
  return {.hits = hits_, .normals = normals_, .points = points_, .sides = sides_};
}

}  // namespace kdray::server
