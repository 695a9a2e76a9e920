// SPDX-License-Identifier: Apache-2.0
// Packets of the frustum kernel: 64 close rays from one origin; or towards one target, as shadow
// rays to a lamp, which is then treated as the origin.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/geometry/local_ray.h"
#include "core/geometry/ray.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/prepared_rays-inl.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// Largest float <= x, and smallest float >= x.
inline float FloatBelow(double x) {
  const float f = static_cast<float>(x);
  return static_cast<double>(f) <= x ? f
                                     : std::nextafter(f, -std::numeric_limits<float>::infinity());
}
inline float FloatAbove(double x) { return -FloatBelow(-x); }

/// The order of a packet's rays: ray i of the rows is at place PlaceOf(i). A group is 16 places.
/// Four rays in a row stay together, so both orders are given by fours.
struct PacketOrder {
  std::uint8_t place_of_four[16];

  std::size_t PlaceOf(std::size_t ray) const { return place_of_four[ray / 4] + ray % 4; }
};
/// The given order.
inline constexpr PacketOrder kInARow = {
    {0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 52, 56, 60}};
/// For tiles of 8 x 8 pixels, row by row: groups of 4 x 4.
inline constexpr PacketOrder kTiled = {
    {0, 16, 4, 20, 8, 24, 12, 28, 32, 48, 36, 52, 40, 56, 44, 60}};

/// All arrays are by place. All rays have one local origin (not moved), or nearly one target; one
/// octant, one largest axis. With a common target, culls use the target as the origin.
struct FrustumRays {
  static constexpr std::size_t kRays = 64;
  static constexpr std::size_t kGroups = kRays / 16;
  static constexpr std::uint64_t kAll = ~std::uint64_t{0};

  alignas(64) float direction[3][kRays];  // as FastIntersection has it
  alignas(64) float shear[2][kRays];      // as WatertightIntersection<float> has it
  alignas(64) float offset[2][kRays];     // shear - shear_middle
  // 1 / direction along axis[2]; in `watertight`, and for any hit in `double` and `exact`.
  alignas(64) float inverse_along[kRays];
  alignas(64) float exit[kRays];  // the end of each ray from the origin, rounded outward
  // The caller's interval, rounded inward: exact for float s.
  alignas(64) float s_min[kRays], s_max[kRays];
  alignas(32) double t_min[kRays], t_max[kRays];  // the caller's, unless all are whole lines
  alignas(64) float scale[kRays];  // direction / the caller's direction: a power of two
  double frame_scale;              // 2^MeshFrame::exponent

  bool shares_target;
  alignas(64) float own_origin[3][kRays];  // with a common target

  Vec3d origin_double;  // the common origin
  D4 given_origin;      // the same as given, without a common target
  Vec3f origin;
  float origin_size;  // largest |component| of an origin that the triangle intersections get
  // Of the directions from the common origin.
  std::uint32_t octant;
  float inverse_low[3], inverse_high[3];
  float ahead;            // 1 or -1: the sign of the directions along axis[2]
  float enter;            // of the whole packet
  bool begins_at_origin;  // no ray begins before it, so none meets what lies behind
  bool is_wide;           // its shears differ by more than kMostShear

  std::uint32_t axis[3];
  float shear_middle[2], shear_reach[2];
  float group_low[2][kGroups], group_high[2][kGroups];  // of `shear`
  const PacketOrder* order;

  /// What 64 rows are.
  enum class Form : std::uint8_t {
    kPacket,
    kMixed,  ///< their directions differ too much; others with those of some may be a packet
    kOther
  };
  /// Whether the 64 rays of these rows form such a packet; fills everything in if so. A common
  /// target is used only for "any", for which the direction of traversal does not matter.
  Form Gather(const KernelJob& job, std::size_t first);

  /// The triangle intersections' origins of the rays at 16 places.
  KDRAY_INLINE F16 OriginAt(std::uint32_t its_axis, const std::uint32_t* place) const {
    return shares_target ? LookUp64(own_origin[its_axis], place)
                         : Set16(origin[static_cast<int>(its_axis)]);
  }

  KDRAY_INLINE F16 DirectionAt(std::uint32_t its_axis, const std::uint32_t* place) const {
    return LookUp64(direction[its_axis], place);
  }
  KDRAY_INLINE F16 DirectionAt(std::uint32_t its_axis, std::size_t first) const {
    return Load16(direction[its_axis] + first);
  }

  /// The lanes whose s, between `low` and `high`, is certainly in the interval of the ray at a
  /// place, or certainly outside; `place` has 16.
  KDRAY_INLINE unsigned IsInside(F16 low, F16 high, const std::uint32_t* place) const {
    if (whole_lines_) {
      return Bits(LessEqual(Set16(0), low) &
                  LessEqual(high, Set16(std::numeric_limits<float>::infinity())));
    }
    return Bits(LessEqual(LookUp64(s_min, place), low) & LessEqual(high, LookUp64(s_max, place)));
  }
  KDRAY_INLINE unsigned IsOutside(F16 low, F16 high, const std::uint32_t* place) const {
    if (whole_lines_) return Bits(Less(high, Set16(0)));
    return Bits(Less(high, LookUp64(s_min, place)) | Less(LookUp64(s_max, place), low));
  }

  /// The same for the rays at 16 places in a row, from `first` on.
  KDRAY_INLINE unsigned IsInside(F16 low, F16 high, std::size_t first) const {
    if (whole_lines_) {
      return Bits(LessEqual(Set16(0), low) &
                  LessEqual(high, Set16(std::numeric_limits<float>::infinity())));
    }
    return Bits(LessEqual(Load16(s_min + first), low) & LessEqual(high, Load16(s_max + first)));
  }
  KDRAY_INLINE unsigned IsOutside(F16 low, F16 high, std::size_t first) const {
    if (whole_lines_) return Bits(Less(high, Set16(0)));
    return Bits(Less(high, Load16(s_min + first)) | Less(Load16(s_max + first), low));
  }
  /// The caller's t of the ray at a place, from its local parameter.
  KDRAY_INLINE double CallerT(double s, std::size_t place) const {
    // + 0 turns -0 into 0.
    return s * (static_cast<double>(scale[place]) * frame_scale) + 0.0;
  }
  // The interval of the ray at a place, in double. Not with a common target.
  KDRAY_INLINE bool IsInInterval(double s, std::size_t place) const {
    const double t = CallerT(s, place);
    return whole_lines_ ? t >= 0 : t >= t_min[place] && t <= t_max[place];
  }
  /// Its ends as local parameters.
  KDRAY_INLINE double LocalStart(std::size_t place) const {
    if (whole_lines_) return 0;
    return t_min[place] / (static_cast<double>(scale[place]) * frame_scale);
  }
  KDRAY_INLINE double LocalEnd(std::size_t place) const {
    if (whole_lines_) return std::numeric_limits<double>::infinity();
    return t_max[place] / (static_cast<double>(scale[place]) * frame_scale);
  }
  KDRAY_INLINE F16 OriginAt(std::uint32_t its_axis, std::size_t first) const {
    return shares_target ? Load16(own_origin[its_axis] + first)
                         : Set16(origin[static_cast<int>(its_axis)]);
  }

  /// The local directions of four rays along an axis of the mesh, beginning at `place`.
  KDRAY_INLINE D4 DoubleDirectionAt(std::size_t k, std::size_t place) const {
    return given_in_double_ ? Load4(direction_double_[k] + place) : Widen4(direction[k] + place);
  }
  /// WatertightIntersection<double>'s of four rays, beginning at `place`.
  struct Shear {
    D4 x, y, inverse_z;
  };
  KDRAY_INLINE Shear ShearAt(std::size_t place) const {
    D4 d[3];
    for (std::size_t k = 0; k < 3; ++k) d[k] = DoubleDirectionAt(axis[k], place);
    return {d[0] / d[2], d[1] / d[2], Set4(1) / d[2]};
  }
  /// The same of the ray at a place, in all lanes.
  KDRAY_INLINE Shear ShearOfOne(std::size_t place) const {
    double d[3];
    for (std::size_t k = 0; k < 3; ++k) {
      d[k] = given_in_double_ ? direction_double_[axis[k]][place]
                              : static_cast<double>(direction[axis[k]][place]);
    }
    return {Set4(d[0] / d[2]), Set4(d[1] / d[2]), Set4(1 / d[2])};
  }

 private:
  // Origins and intervals of the rays as given, by place.
  template <class Number>
  struct Given {
    alignas(64) Number origin[3][kRays], t_min[kRays], t_max[kRays];
  };

  // The largest difference of two shears from a common origin. Towards a target there is no limit:
  // scattered rays pass the same few triangles around it.
  static constexpr float kMostShear = 0.25f;

  static bool IsTile(const KernelJob& job, std::size_t first);
  bool MayBeTogether(const Vec3d& a, const Vec3d& b) const;
  bool SetOrigin(const MeshFrame& frame, const Vec3d& local);
  void ChooseAxes(const Vec3d& d);
  Form GatherFloats(const KernelJob& job, std::size_t first);
  Form GatherDoubles(const KernelJob& job, std::size_t first, Given<double>* given);
  void GatherEnds(const KernelJob& job, std::size_t first, Given<float>* given) const;
  bool FindRanges(bool with_inverse);
  bool FindIntervals(const KernelJob& job, std::size_t first);
  bool FindNearTarget(const MeshFrame& frame, const Given<float>& given);
  template <class Number>
  bool FindTarget(const MeshFrame& frame, const Given<Number>& given);

  bool given_in_double_;
  bool whole_lines_;  // t from 0 to infinity
  alignas(64) double direction_double_[3][kRays];
};

KDRAY_INLINE std::size_t RowAt(const KernelJob& job, std::size_t i) {
  return job.rows != nullptr ? job.rows[i] : i;
}
/// job.rays[row], inline.
KDRAY_INLINE Ray RayAt(const KernelJob& job, std::size_t row) {
  const RayF* floats = job.rays.floats();
  if (floats == nullptr) return job.rays.doubles()[row];
  const RayF& ray = floats[row];
  return {Vec3d(ray.origin), static_cast<double>(ray.t_min), Vec3d(ray.direction),
          static_cast<double>(ray.t_max)};
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
