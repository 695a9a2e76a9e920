// One ray through one structure: the plain path of closest hit and any hit, templated over the leaf
// test and the structure. core/trace/trace.cc picks the instance for a batch; the SIMD engines are
// its siblings.
#pragma once

#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/trace/leaf_test.h"
#include "core/trace/trace.h"

namespace kdray::core {

/// The triangles of a mesh in the numbers a leaf test works with.
template <class Number, class Stored>
class Corners {
 public:
  Corners(std::span<const Vec3<Stored>> vertices, std::span<const TriangleIndices> triangles)
      : vertices_(vertices), triangles_(triangles) {}

  template <class Test>
  bool Test1(const Test& test, PrimitiveId id, LeafHit* hit) const {
    const TriangleIndices& t = triangles_[id];
    return test.Test(Vec3<Number>(vertices_[t[0]]), Vec3<Number>(vertices_[t[1]]),
                     Vec3<Number>(vertices_[t[2]]), hit);
  }

 private:
  std::span<const Vec3<Stored>> vertices_;
  std::span<const TriangleIndices> triangles_;
};

/// Counts nothing, at no cost; or the work of one ray.
struct NoCost {
  void CountNode() {}
  void CountTriangles(std::size_t) {}
};
struct CountCost {
  TraceCost* cost;
  void CountNode() { ++cost->nodes_visited; }
  void CountTriangles(std::size_t n) { cost->triangles_tested += static_cast<std::uint32_t>(n); }
};

/// The closest accepted triangle within the caller's interval; Hit{} on a miss.
template <class Test, class Structure, class Corners, class Cost>
Hit FindClosest(const Structure& structure, const Corners& corners, const LocalRay& ray,
                Cost cost) {
  const Test test(ray);
  Hit best;
  double best_shifted = std::numeric_limits<double>::infinity();  // s + shift: orders hits as t
                                                                  // does, without its overflow
  double limit = std::numeric_limits<double>::infinity();
  // Different s can round to one s + shift: a tie's other triangle may begin this much later.
  const double slack = std::fabs(ray.shift) * 0x1p-50;

  structure.Traverse(
      ray, Test::kPad,
      [&](std::span<const PrimitiveId> leaf) {
        cost.CountTriangles(leaf.size());
        for (const PrimitiveId id : leaf) {
          LeafHit hit;
          if (!corners.Test1(test, id, &hit)) continue;
          const double shifted = hit.s + ray.shift;
          if (!Closer(shifted, id, best_shifted, best.primitive_id)) continue;
          const double t = ray.ToCallerT(hit.s);
          if (!(t >= ray.t_min && t <= ray.t_max)) continue;
          best = {t, hit.u, hit.v, id};
          best_shifted = shifted;
          limit = hit.s + slack;
        }
        return limit;
      },
      [&] { cost.CountNode(); });
  return best;
}

/// Whether FindClosest would find anything.
template <class Test, class Structure, class Corners>
bool FindAny(const Structure& structure, const Corners& corners, const LocalRay& ray) {
  const Test test(ray);
  bool found = false;
  structure.Traverse(
      ray, Test::kPad,
      [&](std::span<const PrimitiveId> leaf) {
        for (const PrimitiveId id : leaf) {
          LeafHit hit;
          if (!corners.Test1(test, id, &hit)) continue;
          const double t = ray.ToCallerT(hit.s);
          if (t >= ray.t_min && t <= ray.t_max) {
            found = true;
            return -std::numeric_limits<double>::infinity();
          }
        }
        return std::numeric_limits<double>::infinity();
      },
      [] {});
  return found;
}

}  // namespace kdray::core
