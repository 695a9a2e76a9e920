// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/sides.h"

#include <array>
#include <cassert>
#include <cstddef>
#include <limits>
#include <vector>

#include "core/geometry/ray.h"
#include "core/proximity/point_batch.h"
#include "core/trace/trace.h"

namespace kdray::core {
namespace {

// Far from all axes and diagonals, along which meshes have edges and many triangles are seen
// edge-on. Any directions give the same parity on a closed mesh.
constexpr std::array<Vec3d, 3> kDirections = {Vec3d{0.8341, 0.3178, 0.4509},
                                              Vec3d{-0.2917, 0.8613, -0.4158},
                                              Vec3d{-0.3862, -0.4731, 0.7919}};

// The work of one batch, over the rows that need rays.
class ParityTest {
 public:
  ParityTest(const Scene& scene, std::span<const Vec3d> points, const PointOptions& options,
             std::span<Side> sides)
      : scene_(scene), points_(points), options_(options), sides_(sides) {}

  /// on_surface is an answer too.
  Status Run(std::span<std::uint8_t> on_surface) {
    if (Status status = FindOnSurface(scene_, points_, options_, on_surface); !status.ok()) {
      return status;
    }
    const Bounds3d& bounds = scene_.mesh->bounds();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const Vec3d& p = points_[i];
      sides_[i] = on_surface[i] != 0 ? Side::kInside : Side::kOutside;
      if (!IsValidPoint(p)) sides_[i] = Side::kUnknown;
      if (on_surface[i] == 0 && bounds.Contains(p)) rows_.push_back(i);
    }
    if (Status status = Count(kDirections[0]); !status.ok()) return status;
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      sides_[rows_[k]] = IsOdd(k) ? Side::kInside : Side::kOutside;
    }
    if (scene_.is_closed) return {};
    for (std::size_t d = 1; d < kDirections.size(); ++d) {
      if (Status status = Count(kDirections[d]); !status.ok()) return status;
      for (std::size_t k = 0; k < rows_.size(); ++k) {
        Side& side = sides_[rows_[k]];
        if (IsOdd(k) != (side == Side::kInside)) side = Side::kUnknown;
      }
    }
    return {};
  }

 private:
  bool IsOdd(std::size_t k) const { return counts_[k] % 2 != 0; }

  // The crossings of a ray in this direction from each row's point.
  Status Count(const Vec3d& direction) {
    rays_.clear();
    for (const std::size_t row : rows_) {
      rays_.push_back({points_[row], 0, direction, std::numeric_limits<double>::infinity()});
    }
    counts_.assign(rows_.size(), 0);
    return TraceCount(scene_, std::span<const Ray>(rays_), {Precision::kExact, options_.cancel},
                      counts_);
  }

  const Scene& scene_;
  const std::span<const Vec3d> points_;
  const PointOptions& options_;
  const std::span<Side> sides_;
  std::vector<std::size_t> rows_;
  std::vector<Ray> rays_;
  std::vector<std::uint32_t> counts_;
};

}  // namespace

Status FindSides(const Scene& scene, std::span<const Vec3d> points, const PointOptions& options,
                 std::span<Side> sides) {
  assert(sides.size() == points.size());
  std::vector<std::uint8_t> on_surface(points.size());
  return ParityTest(scene, points, options, sides).Run(on_surface);
}

Status FindSignedDistances(const Scene& scene, std::span<const Vec3d> points,
                           const PointOptions& options, std::span<double> distances) {
  assert(distances.size() == points.size());
  std::vector<Side> sides(points.size());
  std::vector<std::uint8_t> on_surface(points.size());
  Status status = ParityTest(scene, points, options, sides).Run(on_surface);
  if (!status.ok()) return status;
  std::vector<ClosestPoint> closest(points.size());
  status = FindClosestPoints(scene, points, options, closest);
  if (!status.ok()) return status;
  for (std::size_t i = 0; i < points.size(); ++i) {
    // In double, the distance of a point on the surface may be a rounding error.
    const double distance = on_surface[i] != 0 ? 0 : closest[i].distance;
    distances[i] = sides[i] == Side::kUnknown  ? std::numeric_limits<double>::quiet_NaN()
                   : sides[i] == Side::kInside ? 0 - distance
                                               : distance;
  }
  return {};
}

}  // namespace kdray::core
