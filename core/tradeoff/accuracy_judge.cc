// SPDX-License-Identifier: Apache-2.0
#include "core/tradeoff/accuracy_judge.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "core/geometry/local_ray.h"

namespace kdray::core {
namespace {

// Scaled, because squares of 1e-200 are 0.
double LengthAtAnyScale(const Vec3d& v) {
  const double largest = MaxAbs(v);
  return largest * Length(v * (1 / largest));
}

/// A triangle in the mesh's frame, which scales all axes alike and so keeps angles.
class SeenTriangle {
 public:
  SeenTriangle(const TriangleMesh& mesh, PrimitiveId id)
      : corners_{mesh.LocalCorner(id, 0), mesh.LocalCorner(id, 1), mesh.LocalCorner(id, 2)},
        normal_(Cross(corners_[1] - corners_[0], corners_[2] - corners_[0])),
        twice_area_(Length(normal_)) {}

  /// |cos| between the direction and the normal; 1 for a needle whose normal is only rounding
  /// error.
  double CosineTo(const Vec3d& direction) const {
    if (!(twice_area_ > 0)) return 1;
    return std::fabs(Dot(normal_, NormalizedAtAnyScale(direction))) / twice_area_;
  }

  /// The distance from the hit to the nearest edge, in the triangle's plane.
  double DistanceToBorder(const Hit& hit) const {
    const double weights[3] = {1 - hit.u - hit.v, hit.u, hit.v};
    double nearest = HUGE_VAL;
    for (std::size_t k = 0; k < 3; ++k) {
      const double edge = Length(corners_[(k + 1) % 3] - corners_[(k + 2) % 3]);
      nearest = std::min(nearest, weights[k] * twice_area_ / edge);
    }
    return nearest;
  }

 private:
  std::array<Vec3d, 3> corners_;
  Vec3d normal_;
  double twice_area_;
};

}  // namespace

AccuracyJudge::AccuracyJudge(const TriangleMesh& mesh, Precision precision, bool from_inside)
    : mesh_(mesh) {
  const Vec3d extent = mesh.bounds().Extent();
  extent_ = std::max({extent.x, extent.y, extent.z});
  sum_.precision = precision;
  const bool in_float = TraitsOf(precision).in_float;
  pad_ = in_float ? kFloatPad : kDoublePad;
  tolerance_ = TraitsOf(in_float ? Precision::kWatertight : precision).t_error.value_or(0);
  if (from_inside) sum_.leaks.emplace();
}

void AccuracyJudge::Add(std::span<const Ray> rays, std::span<const Hit> exact,
                        std::span<const Hit> hits) {
  for (std::size_t i = 0; i < rays.size(); ++i) AddRow(rays[i], exact[i], hits[i]);
  if (sum_.leaks) sum_.leaks->rays += rays.size();
  for (ErrorRate* rate : {&sum_.wrong_triangles, &sum_.unconnected_triangles, &sum_.folds,
                          &sum_.missed_hits, &sum_.extra_hits}) {
    rate->rays += rays.size();
  }
}

void AccuracyJudge::AddRow(const Ray& ray, const Hit& exact, const Hit& hit) {
  if (sum_.leaks && !hit.IsHit()) ++sum_.leaks->count;
  if (!hit.IsHit() || !exact.IsHit()) {
    if (exact.IsHit()) ++sum_.missed_hits.count;
    if (hit.IsHit()) ++sum_.extra_hits.count;
    return;
  }
  int shared = 3;
  const double error = ScaledError(ray, exact, hit);
  if (hit.primitive_id != exact.primitive_id) {
    shared = SharedCorners(hit.primitive_id, exact.primitive_id);
    ++sum_.wrong_triangles.count;
    if (shared == 0) ++sum_.unconnected_triangles.count;
    if (error > tolerance_ && IsFold(ray, hit.t < exact.t ? hit : exact)) {
      ++sum_.folds.count;
      return;
    }
  }
  if (shared >= 2) t_errors_.push_back(error);
}

// Compares positions, because in some formats triangles do not share vertices.
int AccuracyJudge::SharedCorners(PrimitiveId a, PrimitiveId b) const {
  int shared = 0;
  for (int i = 0; i < 3; ++i) {
    const Vec3d corner = mesh_.LocalCorner(a, i);
    for (int j = 0; j < 3; ++j) {
      if (corner == mesh_.LocalCorner(b, j)) {
        ++shared;
        break;
      }
    }
  }
  return shared;
}

double AccuracyJudge::ScaledError(const Ray& ray, const Hit& exact, const Hit& hit) const {
  if (hit.t == exact.t) return 0;
  const double cosine = SeenTriangle(mesh_, hit.primitive_id).CosineTo(ray.direction);
  // Quarters, so nothing overflows when t is near the largest double.
  return std::fabs(0.25 * hit.t - 0.25 * exact.t) * cosine /
         (0.25 * std::fabs(exact.t) + 0.25 * (extent_ / LengthAtAnyScale(ray.direction)));
}

bool AccuracyJudge::IsFold(const Ray& ray, const Hit& nearer) const {
  const SeenTriangle triangle(mesh_, nearer.primitive_id);
  // Moving a ray by a pad on each axis moves its hit by the pad over the cosine.
  return triangle.DistanceToBorder(nearer) * triangle.CosineTo(ray.direction) <=
         std::sqrt(3.0) * pad_;
}

Accuracy AccuracyJudge::Sum() const {
  Accuracy sum = sum_;
  if (t_errors_.empty()) return sum;
  std::vector<double> errors = t_errors_;
  const std::size_t rank = (errors.size() - 1) * 999 / 1000;
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(rank),
                   errors.end());
  sum.t_error = {errors.size(), errors[rank], *std::max_element(errors.begin(), errors.end())};
  return sum;
}

}  // namespace kdray::core
