// The leaf test's verdict on one triangle, behind an interface: what every kernel can fall back on,
// whatever the precision and the mesh's vertices.
#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <optional>

#include "core/accel/wide/wide_tree.h"
#include "core/base/cancel_poll.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/precision.h"
#include "core/intersect/triangle_intersection.h"

namespace kdray::core {

/// Holds one ray's search: its form for the leaf test and the closest hit so far. A place in an
/// array of them is used for one ray after the other.
struct alignas(64) ScalarSearchSpace {
  std::byte bytes[576];
};

/// Immutable, so safe from many threads at once, each with spaces of its own.
class ScalarSearch {
 public:
  virtual ~ScalarSearch() = default;

  /// The form of a ray that Begin and Closest take: of `exact`, MakeExactLocalRay's.
  virtual std::optional<LocalRay> MakeRay(const Ray& ray, const MeshFrame& frame) const = 0;
  /// Starts on a ray.
  virtual void Begin(const LocalRay& ray, ScalarSearchSpace* space) const = 0;
  /// Tests a triangle and keeps it when it is the closest so far. Returns whether it did.
  virtual bool Offer(PrimitiveId id, ScalarSearchSpace* space) const = 0;
  /// The local parameter beyond which nothing can be closer than what was kept; infinity at first.
  virtual double Limit(const ScalarSearchSpace& space) const = 0;
  virtual Hit Finish(const ScalarSearchSpace& space) const = 0;

  /// The whole search, one triangle after the other: the reference, and for rays that no kernel
  /// takes. Anything once the poll has stopped.
  virtual Hit Closest(const LocalRay& ray, const WideTree& tree, CancelPoll* poll) const = 0;

  /// What one Offer() or Test() counts as (CancelPoll).
  virtual std::uint64_t work() const = 0;

  /// The leaf test alone, on a ray whose search is somewhere else. Not of `exact`.
  virtual bool Test(const LocalRay& ray, PrimitiveId id, TriangleHit* hit) const = 0;
};

std::unique_ptr<const ScalarSearch> MakeScalarSearch(const TriangleMesh& mesh, Precision precision);

}  // namespace kdray::core
