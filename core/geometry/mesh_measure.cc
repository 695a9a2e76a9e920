// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/mesh_measure.h"

#include <cmath>

#include "core/base/cancel_poll.h"
#include "core/geometry/power_of_two.h"

namespace kdray::core {
namespace {

// A sum whose rounding errors are added up beside it.
class CompensatedSum {
 public:
  void Add(double term) {
    const double next = sum_ + term;
    error_ += std::fabs(sum_) >= std::fabs(term) ? (sum_ - next) + term : (term - next) + sum_;
    sum_ = next;
  }
  double value() const { return sum_ + error_; }

 private:
  double sum_ = 0;
  double error_ = 0;
};

}  // namespace

Result<MeshMeasure> MeasureMesh(const TriangleMesh& mesh, const CancelToken& cancel) {
  CancelPoll poll(cancel);
  CompensatedSum area;    // of parallelograms
  CompensatedSum volume;  // of parallelepipeds
  // Volumes are relative to a corner of the mesh, because its frame's origin may be outside.
  const Vec3d base = mesh.triangle_count() == 0 ? Vec3d() : mesh.LocalCorner(0, 0);
  mesh.VisitVertices([&](auto vertices) {
    PolledLoop(mesh.triangle_count(), 16, &poll, [&](std::size_t i) {
      const auto [first, second, third] = mesh.triangles()[i];
      const Vec3d a = Vec3d(vertices[first]) - base;
      const Vec3d b = Vec3d(vertices[second]) - base;
      const Vec3d c = Vec3d(vertices[third]) - base;
      const Vec3d normal = Cross(b - a, c - a);
      area.Add(Length(normal));
      volume.Add(Dot(a, normal));
    });
  });
  if (poll.stopped()) return poll.ToError();
  const int exponent = mesh.frame().exponent;
  return MeshMeasure{ScaleByPowerOfTwo(area.value() / 2, 2 * exponent),
                     ScaleByPowerOfTwo(volume.value() / 6, 3 * exponent)};
}

}  // namespace kdray::core
