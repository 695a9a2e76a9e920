// Holds the hits of one precision against the exact ones.
#pragma once

#include <span>
#include <vector>

#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/tradeoff/tradeoff.h"

namespace kdray::core {

/// Collects rows, then sums them up. The mesh must outlive it. One thread at a time.
class AccuracyJudge {
 public:
  /// `from_inside`: rays start strictly inside the mesh, so that a miss is a leak.
  AccuracyJudge(const TriangleMesh& mesh, Precision precision, bool from_inside);

  /// As many rays as hits and exact hits.
  void Add(std::span<const Ray> rays, std::span<const Hit> exact, std::span<const Hit> hits);
  Accuracy Sum() const;

 private:
  void AddRow(const Ray& ray, const Hit& exact, const Hit& hit);
  int SharedCorners(PrimitiveId a, PrimitiveId b) const;
  double ScaledError(const Ray& ray, const Hit& exact, const Hit& hit) const;
  bool IsFold(const Ray& ray, const Hit& nearer) const;

  const TriangleMesh& mesh_;
  double extent_;
  double pad_;        // by which rounding may move a ray, local units
  double tolerance_;  // of the scaled error of t, beyond which a fold is looked for
  Accuracy sum_;
  std::vector<double> t_errors_;
};

}  // namespace kdray::core
