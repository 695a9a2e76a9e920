// SPDX-License-Identifier: Apache-2.0
// What an answer says of a hit beside t, triangle, u and v.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "api/row_sink.h"
#include "api/types.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/io/mesh_attributes.h"
#include "core/scene/scene.h"
#include "server/mapping.h"

namespace kdray::server {

/// The attributes of the mesh's file that the fields need.
core::AttributeKinds AttributesFor(const api::RayOptions& options);

/// The details that a request names, for some hits at a time. Used by one thread; its memory is
/// reused.
class HitDetails {
 public:
  /// `attributes` may be null if no field needs them.
  HitDetails(const core::Scene& scene, const core::MeshAttributes* attributes,
             const api::RayOptions& options)
      : scene_(scene), attributes_(attributes), options_(options) {}

  /// Hit i belongs to ray_of(i), a core::Ray. The result is valid until the next call, and as long
  /// as `hits`.
  template <class RayOf>
  api::Hits Fill(std::span<const core::Hit> hits, const RayOf& ray_of) {
    if (wants_details_) {
      Begin(hits.size());
      for (std::size_t i = 0; i < hits.size(); ++i) {
        if (hits[i].IsHit()) FillHit(i, ray_of(i), hits[i]);
      }
    }
    return View(hits);
  }

 private:
  void Begin(std::size_t count);
  void FillHit(std::size_t i, const core::Ray& ray, const core::Hit& hit);
  api::Hits View(std::span<const core::Hit> hits) const;

  const core::Scene& scene_;
  const core::MeshAttributes* attributes_;
  const api::RayOptions& options_;
  const bool wants_details_ = HasDetails(options_);
  std::vector<api::Vec3> normals_, points_;
  std::vector<std::int8_t> sides_;
  std::vector<std::int32_t> groups_;
  std::vector<std::array<double, 2>> uvs_;
  std::vector<api::Vec3> shading_normals_;

  static bool HasDetails(const api::RayOptions& options);
};

}  // namespace kdray::server
