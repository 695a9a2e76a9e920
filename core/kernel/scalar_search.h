// SPDX-License-Identifier: Apache-2.0
// The search of one ray with the scalar triangle intersection, as an interface for every precision
// and vertex type: the fallback of all kernels.
#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <span>

#include "core/accel/wide/wide_tree.h"
#include "core/base/cancel_poll.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/hit_filter.h"
#include "core/intersect/precision.h"
#include "core/intersect/triangle_intersection.h"

namespace kdray::core {

/// Memory of one ray's search: the test's form of the ray and the closest hit so far. Reused for
/// one ray after the other.
struct alignas(64) ScalarSearchSpace {
  std::byte bytes[576];
};

/// Immutable, so safe from many threads at once, each with its own spaces.
class ScalarSearch {
 public:
  virtual ~ScalarSearch() = default;

  /// The form of a ray for Begin and Closest: for `exact`, that of MakeExactLocalRay.
  virtual std::optional<LocalRay> MakeRay(const Ray& ray, const MeshFrame& frame) const = 0;
  /// Starts the search of a ray.
  virtual void Begin(const LocalRay& ray, ScalarSearchSpace* space) const = 0;
  /// Tests a triangle and keeps it if it is the closest so far. Returns whether it was kept.
  virtual bool Offer(PrimitiveId id, ScalarSearchSpace* space) const = 0;
  /// The local parameter beyond which no triangle can be closer than the kept one; infinity at
  /// first.
  virtual double Limit(const ScalarSearchSpace& space) const = 0;
  virtual Hit Finish(const ScalarSearchSpace& space) const = 0;

  // For `count` and `all`, after Begin().

  /// Whether the triangle is one of FindAll (core/intersect/all_search.h), the filter apart.
  virtual bool Crosses(PrimitiveId id, ScalarSearchSpace* space) const = 0;
  /// The answer for a triangle that is hit.
  virtual Hit Answer(PrimitiveId id, ScalarSearchSpace* space) const = 0;
  /// Sorts the hits of triangles, which all have the same t: in `exact` by the exact t, then by id.
  /// Unspecified if the poll stops.
  virtual void OrderTies(std::span<Hit> hits, ScalarSearchSpace* space, CancelPoll* poll) const = 0;

  /// The whole search, one triangle after the other: the reference, and for rays that no kernel
  /// takes. Unspecified if the poll stops.
  virtual Hit Closest(const LocalRay& ray, const WideTree& tree, CancelPoll* poll) const = 0;

  /// Work (CancelPoll) of one Offer() or Test().
  virtual std::uint64_t work() const = 0;

  /// Only the triangle intersection, for a ray whose search is elsewhere. Not for `exact`.
  virtual bool Test(const LocalRay& ray, PrimitiveId id, TriangleHit* hit) const = 0;
};

/// `filter` may be null; it must outlive the search.
std::unique_ptr<const ScalarSearch> MakeScalarSearch(const TriangleMesh& mesh, Precision precision,
                                                     const HitFilter* filter = nullptr);

}  // namespace kdray::core
