// SPDX-License-Identifier: Apache-2.0
// How `auto` chooses a build: box for a mesh that needs no tree, else the one of kd-sah and bvh
// that rays pass faster by their expected costs (expected_cost.h). Where the boxes of triangles
// overlap little, that is bvh, so only bvh is built (DESIGN.md, decision 45).
#pragma once

#include <cstddef>
#include <optional>

#include "core/accel/build_kind.h"
#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Meshes for which `auto` takes the box.
constexpr bool NeedsNoTree(std::size_t triangle_count) { return triangle_count <= 12; }

/// The number of boxes of triangles that a random line through the mesh's bounds is expected to
/// meet: the sum of the boxes' areas, divided by that of the bounds. Degenerate triangles do not
/// count; 0 without any other. The same for every number of threads; in parallel within the
/// caller's arena. O(triangles). Errors: kCancelled, kDeadlineExceeded.
Result<double> BoxOverlap(const TriangleMesh& mesh, const CancelToken& cancel = {});

/// The numbers by which `auto` chose. They depend on the mesh alone.
struct AutoChoice {
  /// Up to this overlap only bvh is built.
  static constexpr double kLittleOverlap = 10;
  /// kd-sah is taken if its cost, times this, is below that of bvh. At equal cost, rays took 0.9 to
  /// 1.5 times as long in kd-sah on 13 meshes (docs/experiments/wide_tree.md). It also takes twice
  /// the memory, because it repeats triangles in several leaves.
  static constexpr double kKdSahFactor = 4.0 / 3;

  struct Costs {
    double bvh = 0;  ///< ExpectedCost of each
    double kd_sah = 0;
    friend bool operator==(const Costs&, const Costs&) = default;
  };

  double overlap = 0;          ///< BoxOverlap
  std::optional<Costs> costs;  ///< nullopt if only bvh was built

  bool OverlapsLittle() const { return overlap <= kLittleOverlap; }
  BuildKind build() const {
    const bool is_kd_sah = costs && kKdSahFactor * costs->kd_sah < costs->bvh;
    return is_kd_sah ? BuildKind::kKdSah : BuildKind::kBvh;
  }
  friend bool operator==(const AutoChoice&, const AutoChoice&) = default;
};

}  // namespace kdray::core
