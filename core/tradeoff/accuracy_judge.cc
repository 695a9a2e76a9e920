#include "core/tradeoff/accuracy_judge.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace kdray::core {

AccuracyJudge::AccuracyJudge(const TriangleMesh& mesh, Precision precision, bool from_inside)
    : mesh_(mesh) {
  const Vec3d extent = mesh.bounds().Extent();
  extent_ = std::max({extent.x, extent.y, extent.z});
  sum_.precision = precision;
  if (from_inside) sum_.leaks.emplace();
}

void AccuracyJudge::Add(std::span<const Ray> rays, std::span<const Hit> exact,
                        std::span<const Hit> hits) {
  for (std::size_t i = 0; i < rays.size(); ++i) AddRow(rays[i], exact[i], hits[i]);
  if (sum_.leaks) sum_.leaks->rays += rays.size();
  for (ErrorRate* rate :
       {&sum_.wrong_triangles, &sum_.unconnected_triangles, &sum_.missed_hits, &sum_.extra_hits}) {
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
  if (hit.primitive_id != exact.primitive_id) {
    shared = SharedCorners(hit.primitive_id, exact.primitive_id);
    ++sum_.wrong_triangles.count;
    if (shared == 0) ++sum_.unconnected_triangles.count;
  }
  if (shared >= 2) t_errors_.push_back(ScaledError(ray, exact, hit));
}

// By position: in some formats no two triangles share a vertex.
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
  // The frame scales all axes alike, so local corners have the normal of the triangle.
  const Vec3d a = mesh_.LocalCorner(hit.primitive_id, 0);
  const Vec3d normal =
      Cross(mesh_.LocalCorner(hit.primitive_id, 1) - a, mesh_.LocalCorner(hit.primitive_id, 2) - a);
  const double area = Length(normal);
  const double length = Length(ray.direction);
  // A needle whose normal is lost in rounding says nothing about the angle.
  const double cosine = area > 0 ? std::fabs(Dot(normal, ray.direction)) / (area * length) : 1.0;
  return std::fabs(hit.t - exact.t) * cosine / (std::fabs(exact.t) + extent_ / length);
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
