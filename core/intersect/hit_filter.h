// SPDX-License-Identifier: Apache-2.0
// Which of the triangles that a ray hits count as hits: the sides that it may meet (`cull`), and
// the surfaces on which it begins and ends (`t_min=auto`, `t_max=auto`). The same in every
// precision.
#pragma once

#include <cstdint>
#include <string_view>

#include "core/base/enumerators.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/precision.h"

namespace kdray::core {

/// The sides of triangles that are no hits. From a triangle's front, its corners run
/// counter-clockwise in the order of the file.
enum class Cull : std::uint8_t { kNone, kBack, kFront };
/// "none", "back", "front".
constexpr std::string_view Name(Cull cull) {
  switch (cull) {
    case Cull::kNone:
      return "none";
    case Cull::kBack:
      return "back";
    case Cull::kFront:
      return "front";
  }
  return {};
}
inline constexpr auto kAllCulls = kAll<Cull>;

/// 1 if the ray meets the triangle's front, -1 if its back: the sign, for the real numbers as
/// given, of the angle between the ray and the normal. A ray that lies in the triangle's plane,
/// which only the rounded precisions may find to hit, gives -1. `ray` must be valid.
int SideMet(const TriangleMesh& mesh, const Ray& ray, PrimitiveId id);

/// The largest distance from a triangle's plane, in world units, at which a ray still begins or
/// ends on that triangle: room for the rounding of a point of the surface to the numbers of the
/// request (floats or doubles), and of the precision's intersection test. A constant of a mesh, a
/// precision and a number type.
double SurfaceOffset(const TriangleMesh& mesh, Precision precision, bool float_rows);

/// Immutable, so safe from many threads at once. Keeps a reference to the mesh.
class HitFilter {
 public:
  struct Options {
    Cull cull = Cull::kNone;
    bool starts_on_surface = false;  ///< the origin lies on the mesh
    bool ends_on_surface = false;    ///< origin + direction lies on the mesh
    double surface_offset = 0;       ///< of SurfaceOffset
    friend bool operator==(const Options&, const Options&) = default;
  };

  HitFilter(const TriangleMesh& mesh, const Options& options);

  /// Whether it drops any triangle at all.
  bool is_active() const {
    return options_.cull != Cull::kNone || options_.starts_on_surface || options_.ends_on_surface;
  }
  /// False for a hit on a culled side, and for a triangle whose plane is within the offset of an
  /// end that lies on the surface. Both are decided exactly for the numbers as given, so they
  /// depend on nothing but the ray and the triangle. `ray` must be valid.
  bool Keeps(const Ray& ray, PrimitiveId id) const;

 private:
  const TriangleMesh& mesh_;
  Options options_;
  double local_offset_;  // in the mesh's frame
};

/// A filter, or none, for the hits of one ray. Both pointers must outlive it.
struct RayFilter {
  const HitFilter* filter = nullptr;
  const Ray* ray = nullptr;  ///< as given

  bool Keeps(PrimitiveId id) const { return filter == nullptr || filter->Keeps(*ray, id); }
};

}  // namespace kdray::core
