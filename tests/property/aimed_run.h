// SPDX-License-Identifier: Apache-2.0
// Traces rays that must hit in every precision, and counts leaks and differences of t from `exact`.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "core/intersect/precision.h"
#include "tests/property/closed_meshes.h"

namespace kdray::test {

/// Answers of one precision compared with those of `exact` on the same rays. Their t may differ by
/// e * (|t| + extent/|direction|) / |cos|, extent being the mesh's longest side and cos that
/// between the ray and the named triangle's normal.
struct Agreement {
  // Within the bound, by the two triangles:
  std::size_t same = 0, neighbours = 0;  ///< the same one; two that share an edge
  std::size_t corners = 0;  ///< two that share less: the ray goes through a corner, where many tie
  /// Beyond it, but explained: the nearer of the two hits is within a pad (core/geometry/
  /// local_ray.h) of its triangle's border. In one precision the ray touches a fold of the surface
  /// there, in the other it passes.
  std::size_t folds = 0;
  std::size_t unexplained = 0;
  double largest = 0;  ///< the largest difference of those within the bound, in bounds
};

struct AimedRun {
  std::size_t rays = 0;
  std::array<std::size_t, core::kAllPrecisions.size()> leaks{};  ///< by the precision's value
  Agreement watertight, doubled;

  AimedRun& operator+=(const AimedRun& other);
};

/// Traces `count` rays of the family, in blocks, in every precision.
AimedRun RunAimed(const ClosedMesh& mesh, const RayFamily& family, std::size_t count,
                  std::mt19937_64& engine);

/// Prints a row per precision (lines that begin with "| ", of which tests/accuracy makes its
/// table). Expects no leaks except in `fast`, which guarantees nothing, and no unexplained
/// difference of t.
void ExpectTight(std::string_view family, std::string_view mesh, const AimedRun& run);

}  // namespace kdray::test
