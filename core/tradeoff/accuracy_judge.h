// SPDX-License-Identifier: Apache-2.0
// Compares the hits of one precision with the exact ones.
#pragma once

#include <span>
#include <vector>

#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/tradeoff/tradeoff.h"

namespace kdray::core {

/// Collects rows, then summarises them. The mesh must outlive it. For one thread at a time.
class AccuracyJudge {
 public:
  /// `from_inside`: rays start strictly inside the mesh, so a miss is a leak.
  AccuracyJudge(const TriangleMesh& mesh, Precision precision, bool from_inside);

  /// The three must have the same size.
  void Add(std::span<const Ray> rays, std::span<const Hit> exact, std::span<const Hit> hits);
  Accuracy Sum() const;

 private:
  void AddRow(const Ray& ray, const Hit& exact, const Hit& hit);
  int SharedCorners(PrimitiveId a, PrimitiveId b) const;
  double ScaledError(const Ray& ray, const Hit& exact, const Hit& hit) const;
  bool IsFold(const Ray& ray, const Hit& nearer) const;

  const TriangleMesh& mesh_;
  double extent_;
  double pad_;        // bound of a ray's displacement by rounding, local units
  double tolerance_;  // of the scaled error of t; above it, a fold is suspected
  Accuracy sum_;
  std::vector<double> t_errors_;
};

}  // namespace kdray::core
