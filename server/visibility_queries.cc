// SPDX-License-Identifier: Apache-2.0
#include "server/visibility_queries.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/base/parallel.h"
#include "core/geometry/ray.h"
#include "core/intersect/hit_filter.h"
#include "server/mapping.h"

namespace kdray::server {
namespace {

// Rays of a block: large enough for the tracer to sort and share out.
constexpr std::size_t kBlockRays = 131'072;
// Rays that one thread makes at a time.
constexpr std::size_t kGrainRays = 8192;

core::Vec3d ToVec(const api::Vec3& v) { return {v[0], v[1], v[2]}; }

class Pairs {
 public:
  Pairs(const api::PointSets& sets, const api::VisibilityOptions& options)
      : sets_(sets), options_(options) {
    const bool segment = !options.to_directions;
    t_min_ = options.t_min.value_or(0);
    t_max_ = !segment ? std::numeric_limits<double>::infinity() : options.t_max.value_or(1);
  }
  std::size_t size() const { return sets_.from.size() * sets_.to.size(); }

  core::Ray RayOf(std::size_t pair) const {
    const core::Vec3d from = ToVec(sets_.from[pair / sets_.to.size()]);
    const core::Vec3d to = ToVec(sets_.to[pair % sets_.to.size()]);
    return {from, t_min_, options_.to_directions ? to : to - from, t_max_};
  }
  /// Whether a pair is visible if its ray hits nothing.
  bool MaySee(const core::Ray& ray) const {
    return core::IsValid(ray) || (!options_.to_directions && core::IsFinite(ray.origin) &&
                                  ray.direction == core::Vec3d{});
  }

 private:
  const api::PointSets& sets_;
  const api::VisibilityOptions& options_;
  double t_min_, t_max_;
};

void ListInvalid(const api::PointSets& sets, bool to_directions,
                 std::vector<std::uint64_t>* invalid) {
  for (std::size_t i = 0; i < sets.from.size(); ++i) {
    if (!core::IsFinite(ToVec(sets.from[i]))) invalid->push_back(i);
  }
  for (std::size_t i = 0; i < sets.to.size(); ++i) {
    const core::Vec3d to = ToVec(sets.to[i]);
    if (!core::IsFinite(to) || (to_directions && to == core::Vec3d{})) {
      invalid->push_back(sets.from.size() + i);
    }
  }
}

}  // namespace

core::Status AnswerVisibility(const core::Scene& scene, const api::PointSets& sets,
                              const api::VisibilityOptions& options,
                              const core::TraceOptions& trace, api::VisibilityAnswer* answer) {
  core::TraceOptions any = trace;
  any.cull = ToCore(options.cull);
  any.starts_on_surface = !options.t_min;
  any.ends_on_surface = !options.t_max && !options.to_directions;
  if (any.starts_on_surface || any.ends_on_surface) {
    any.surface_offset =
        core::SurfaceOffset(*scene.mesh, trace.precision, sets.number_type == api::NumberType::kF4);
    answer->offset = any.surface_offset;
  }
  ListInvalid(sets, options.to_directions, &answer->invalid);

  const Pairs pairs(sets, options);
  const std::size_t columns = sets.to.size();
  const std::size_t row_bytes = options.bits ? (columns + 7) / 8 : columns;
  answer->visible.assign(sets.from.size() * row_bytes, 0);
  std::vector<core::Ray> rays(std::min(pairs.size(), kBlockRays));
  std::vector<std::uint8_t> occluded(rays.size());
  for (std::size_t first = 0; first < pairs.size(); first += kBlockRays) {
    const std::size_t count = std::min(kBlockRays, pairs.size() - first);
    core::ParallelFor(0, count, kGrainRays, [&](std::size_t i, std::size_t last) {
      for (; i < last; ++i) rays[i] = pairs.RayOf(first + i);
    });
    const core::Status status = core::TraceAny(scene, std::span<const core::Ray>(rays).first(count),
                                               any, std::span(occluded).first(count));
    if (!status.ok()) return status;
    for (std::size_t i = 0; i < count; ++i) {
      if (occluded[i] != 0 || !pairs.MaySee(rays[i])) continue;
      const std::size_t row = (first + i) / columns, column = (first + i) % columns;
      if (options.bits) {
        answer->visible[row * row_bytes + column / 8] |=
            static_cast<std::uint8_t>(0x80u >> (column % 8));
      } else {
        answer->visible[row * row_bytes + column] = 1;
      }
    }
  }
  return {};
}

}  // namespace kdray::server
