// SPDX-License-Identifier: Apache-2.0
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

core::AttributeKinds AttributesFor(const api::RayOptions& options) {
  using enum api::RayField;
  core::AttributeKinds kinds;
  if (options.Names(kGroup)) kinds.Add(core::AttributeKind::kGroup);
  if (options.Names(kUv)) kinds.Add(core::AttributeKind::kUv);
  if (options.Names(kShadingNormal)) kinds.Add(core::AttributeKind::kShadingNormal);
  return kinds;
}

bool HitDetails::HasDetails(const api::RayOptions& options) {
  using enum api::RayField;
  return options.Names(kNormal) || options.Names(kPoint) || options.Names(kSide) ||
         !AttributesFor(options).empty();
}

void HitDetails::Begin(std::size_t count) {
  using enum api::RayField;
  if (options_.Names(kNormal)) normals_.assign(count, kNoVector);
  if (options_.Names(kPoint)) points_.assign(count, kNoVector);
  if (options_.Names(kSide)) sides_.assign(count, 0);
  if (options_.Names(kGroup)) groups_.assign(count, core::MeshAttributes::kNoGroup);
  if (options_.Names(kUv)) uvs_.assign(count, {kNaN, kNaN});
  if (options_.Names(kShadingNormal)) shading_normals_.assign(count, kNoVector);
}

void HitDetails::FillHit(std::size_t i, const core::Ray& ray, const core::Hit& hit) {
  const core::TriangleMesh& mesh = *scene_.mesh;
  if (!normals_.empty()) normals_[i] = ToVec(core::UnitNormal(mesh, hit.primitive_id));
  if (!points_.empty()) points_[i] = ToVec(PointOf(mesh, hit));
  if (!sides_.empty()) {
    sides_[i] = static_cast<std::int8_t>(core::SideMet(mesh, ray, hit.primitive_id));
  }
  if (!groups_.empty()) groups_[i] = attributes_->Group(hit.primitive_id);
  if (!uvs_.empty()) uvs_[i] = attributes_->Uv(hit.primitive_id, hit.u, hit.v);
  if (!shading_normals_.empty()) {
    shading_normals_[i] = ToVec(attributes_->ShadingNormal(hit.primitive_id, hit.u, hit.v));
  }
}

api::Hits HitDetails::View(std::span<const core::Hit> hits) const {
  return {.hits = ToApi(hits),
          .normals = normals_,
          .points = points_,
          .sides = sides_,
          .groups = groups_,
          .uvs = uvs_,
          .shading_normals = shading_normals_};
}

}  // namespace kdray::server
