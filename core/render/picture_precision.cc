// SPDX-License-Identifier: Apache-2.0
#include "core/render/picture_precision.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <span>

#include "core/base/cancel_poll.h"
#include "core/base/parallel.h"
#include "core/geometry/bounds3.h"
#include "core/geometry/power_of_two.h"

namespace kdray::core {
namespace {

constexpr double kShareOfPixel = 0.01;
constexpr std::size_t kPiece = std::size_t{1} << 14;  // vertices between two polls
constexpr std::uint64_t kWorkPerVertex = 4;           // CancelPoll

double Distance(const Vec3d& v) { return std::hypot(v.x, v.y, v.z); }

// Largest error of rounding a double of at most this magnitude to float.
double FloatRounding(double magnitude) {
  constexpr int kBits = 24;
  constexpr int kSmallest = -149;  // exponent of the smallest float
  int exponent = 0;
  std::frexp(magnitude, &exponent);
  return std::ldexp(0.5, std::max(exponent - kBits, kSmallest));
}

// A bound of the distance by which rounding to float moves a vertex, local units.
double MovementBound(const TriangleMesh& mesh) {
  const Vec3d low = mesh.frame().ToLocal(mesh.bounds().min);
  const Vec3d high = mesh.frame().ToLocal(mesh.bounds().max);
  const auto rounding = [&](int axis) {
    return FloatRounding(std::max(std::abs(low[axis]), std::abs(high[axis])));
  };
  return Distance({rounding(0), rounding(1), rounding(2)});
}

// Whether rounding to float moves a vertex by more than `limit`. Points between vertices move less.
bool MovesFurther(std::span<const Vec3d> vertices, double limit, const CancelToken& cancel) {
  std::atomic<bool> found{false};
  const std::size_t pieces = (vertices.size() + kPiece - 1) / kPiece;
  ParallelFor(0, pieces, 4, [&](std::size_t first, std::size_t last) {
    CancelPoll poll(cancel);
    for (std::size_t i = first; i < last && !found; ++i) {
      if (poll.Spend(kPiece * kWorkPerVertex)) return;
      const std::size_t begin = i * kPiece;
      for (const Vec3d& v : vertices.subspan(begin, std::min(kPiece, vertices.size() - begin))) {
        const Vec3d moved = Vec3d(Vec3f(v)) - v;
        if (Dot(moved, moved) > limit * limit) found = true;
      }
    }
  });
  return found;
}

}  // namespace

Precision PicturePrecision(const TriangleMesh& mesh, const Camera& camera,
                           const CancelToken& cancel) {
  const Bounds3d& bounds = mesh.bounds();
  const Precision own = AutoPrecision(mesh);
  if (own == Precision::kWatertight || bounds.Contains(camera.eye)) return own;
  if (!mesh.has_double_vertices()) return Precision::kWatertight;
  const double nearest = Distance(Max(bounds.min, Min(bounds.max, camera.eye)) - camera.eye);
  const double limit =
      ScaleByPowerOfTwo(kShareOfPixel * camera.PixelSize(nearest), -mesh.frame().exponent);
  if (MovementBound(mesh) <= limit) return Precision::kWatertight;
  return MovesFurther(mesh.vertices<double>(), limit, cancel) ? own : Precision::kWatertight;
}

}  // namespace kdray::core
