// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/hit_filter.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "core/geometry/dyadic.h"
#include "core/intersect/hit_sides.h"

namespace kdray::core {
namespace {

constexpr double kUnit = 0x1p-53;  // half an ulp of 1
constexpr double kUnderflow =
    0x1p-1000;  // more than all products of numbers up to 8 that underflow

using Triangle = std::array<Vec3d, 3>;

Triangle CornersOf(const TriangleMesh& mesh, PrimitiveId id) {
  return {mesh.LocalCorner(id, 0), mesh.LocalCorner(id, 1), mesh.LocalCorner(id, 2)};
}

/// A triangle's normal, and for each component the sum of the sizes of its two products: what its
/// error is relative to.
struct RoundedNormal {
  Vec3d at;
  Vec3d size;

  explicit RoundedNormal(const Triangle& triangle) {
    const Vec3d b = triangle[1] - triangle[0], c = triangle[2] - triangle[0];
    for (int k = 0; k < 3; ++k) {
      const int i = k == 2 ? 0 : k + 1;
      const int j = i == 2 ? 0 : i + 1;
      const double left = b[i] * c[j], right = b[j] * c[i];
      at[k] = left - right;
      size[k] = std::fabs(left) + std::fabs(right);
    }
  }
};

struct DyadicVec3 {
  Dyadic x, y, z;
};
DyadicVec3 Exactly(const Vec3d& v) { return {Dyadic(v.x), Dyadic(v.y), Dyadic(v.z)}; }
DyadicVec3 Difference(const DyadicVec3& a, const DyadicVec3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
Dyadic DotOf(const DyadicVec3& a, const DyadicVec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
DyadicVec3 ExactNormal(const Triangle& triangle) {
  const DyadicVec3 a = Exactly(triangle[0]);
  const DyadicVec3 b = Difference(Exactly(triangle[1]), a);
  const DyadicVec3 c = Difference(Exactly(triangle[2]), a);
  return {b.y * c.z - b.z * c.y, b.z * c.x - b.x * c.z, b.x * c.y - b.y * c.x};
}

/// A power of two that brings the largest component into [1, 2), or for denormal numbers below it;
/// 0 for numbers from 2^1023 on, which are left to exact arithmetic.
double ScaleToOne(const Vec3d& v) {
  constexpr std::uint64_t kExponent = 0x7ff0000000000000u, kMost = 0x7fe0000000000000u;
  return std::bit_cast<double>(kMost - (std::bit_cast<std::uint64_t>(MaxAbs(v)) & kExponent));
}

/// An end of a ray: its origin, or origin + direction.
struct RayEnd {
  const Ray& ray;
  bool is_origin;

  /// In the mesh's frame, to within `error` on each axis.
  Vec3d Rounded(const MeshFrame& frame, double* error) const {
    const Vec3d origin = frame.ToLocal(ray.origin);
    *error = kUnit * MaxAbs(origin);
    if (is_origin) return origin;
    Vec3d end;
    for (int k = 0; k < 3; ++k) {
      end[k] = origin[k] + ScaleByPowerOfTwo(ray.direction[k], -frame.exponent);
    }
    *error += kUnit * MaxAbs(end);
    return end;
  }
  DyadicVec3 Exact(const MeshFrame& frame) const {
    std::array<Dyadic, 3> at;
    for (int k = 0; k < 3; ++k) {
      Dyadic end = Dyadic(ray.origin[k]) - Dyadic(frame.origin[k]);
      if (!is_origin) end = end + Dyadic(ray.direction[k]);
      at[static_cast<std::size_t>(k)] = end.TimesPowerOfTwo(-frame.exponent);
    }
    return {at[0], at[1], at[2]};
  }
};

// The distance is at most the offset exactly if |n . (p - a)| <= offset |n|.
bool IsWithinExactly(const MeshFrame& frame, const RayEnd& end, const Triangle& triangle,
                     double offset) {
  const DyadicVec3 normal = ExactNormal(triangle);
  const Dyadic volume = DotOf(normal, Difference(end.Exact(frame), Exactly(triangle[0])));
  const Dyadic most = Dyadic(offset) * Dyadic(offset) * DotOf(normal, normal);
  return (volume * volume - most).Sign() <= 0;
}

/// The room that a precision's test needs, in the mesh's largest local coordinate.
double ShareOfTest(Precision precision) {
  if (precision == Precision::kExact) return 0;
  return TraitsOf(precision).in_float ? 0x1p-20 : 0x1p-44;
}

/// Whether an end lies within `offset` (mesh's frame) of a triangle's plane.
bool IsWithin(const MeshFrame& frame, const RayEnd& end, const Triangle& triangle, double offset) {
  double end_error = 0;
  const Vec3d point = end.Rounded(frame, &end_error);
  const RoundedNormal normal(triangle);
  // A component of the normal is off by less than 5 units of its size, one of `from` by a unit of
  // it and the end's error, and the sum of three products by 5 more units. All of that, rounded up.
  double volume = 0, error = kUnderflow, size = 0;
  for (int k = 0; k < 3; ++k) {
    const double from = point[k] - triangle[0][k];
    volume += normal.at[k] * from;
    error += normal.size[k] * (16 * kUnit * std::fabs(from) + 2 * end_error);
    size += normal.size[k];
  }
  const double length = Length(normal.at);
  // Below, squares may have underflowed.
  if (length > 0x1p-450) {
    const double most = offset * length;
    const double error_of_most = offset * 16 * kUnit * size;
    const double distance = std::fabs(volume);
    if (distance - error > most + error_of_most) return false;
    if (distance + error < most - error_of_most) return true;
  }
  return IsWithinExactly(frame, end, triangle, offset);
}

}  // namespace

int SideMet(const Ray& ray, const Triangle& triangle) {
  const RoundedNormal normal(triangle);
  const double scale = ScaleToOne(ray.direction);
  double along = 0, error = kUnderflow;
  for (int k = 0; k < 3; ++k) {
    const double direction = ray.direction[k] * scale;
    along += normal.at[k] * direction;
    error += 16 * kUnit * normal.size[k] * std::fabs(direction);
  }
  if (std::fabs(along) > error) return along < 0 ? 1 : -1;
  return DotOf(ExactNormal(triangle), Exactly(ray.direction)).Sign() < 0 ? 1 : -1;
}

int SideMet(const TriangleMesh& mesh, const Ray& ray, PrimitiveId id) {
  return SideMet(ray, CornersOf(mesh, id));
}

namespace {

bool KeepsTriangle(const HitFilter::Options& options, const MeshFrame& frame, double local_offset,
                   const Ray& ray, const Triangle& triangle) {
  if (options.cull != Cull::kNone) {
    const int culled = options.cull == Cull::kFront ? 1 : -1;
    if (SideMet(ray, triangle) == culled) return false;
  }
  return !(options.starts_on_surface && IsWithin(frame, {ray, true}, triangle, local_offset)) &&
         !(options.ends_on_surface && IsWithin(frame, {ray, false}, triangle, local_offset));
}

}  // namespace

double SurfaceOffset(const TriangleMesh& mesh, Precision precision, bool float_rows) {
  const MeshFrame& frame = mesh.frame();
  const double local =
      std::max(MaxAbs(frame.ToLocal(mesh.bounds().min)), MaxAbs(frame.ToLocal(mesh.bounds().max)));
  const double largest = std::max(MaxAbs(mesh.bounds().min), MaxAbs(mesh.bounds().max));
  return ScaleByPowerOfTwo(ShareOfTest(precision) * local, frame.exponent) +
         (float_rows ? 0x1p-21 : 0x1p-49) * largest;
}

HitFilter::HitFilter(const TriangleMesh& mesh, const Options& options)
    : mesh_(mesh),
      options_(options),
      local_offset_(ScaleByPowerOfTwo(options.surface_offset, -mesh.frame().exponent)) {}

bool HitFilter::Keeps(const Ray& ray, PrimitiveId id) const {
  return KeepsTriangle(options_, mesh_.frame(), local_offset_, ray, CornersOf(mesh_, id));
}

bool KeepsHit(const HitFilter::Options& options, const MeshFrame& frame, const Ray& ray,
              const Triangle& triangle) {
  return KeepsTriangle(options, frame, ScaleByPowerOfTwo(options.surface_offset, -frame.exponent),
                       ray, triangle);
}

}  // namespace kdray::core
