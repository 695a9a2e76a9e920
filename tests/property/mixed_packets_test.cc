// SPDX-License-Identifier: Apache-2.0
// N20 for batches whose rays the kernels group anew. Every ray is answered as it is alone.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <random>
#include <span>
#include <vector>

#include "core/base/parallel.h"
#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

// The places of the stream kernel are used by one ray after the other: first by rays from far away,
// with small components along z, then by rays that begin just above a triangle.
TEST(N20MixedPackets, TheStreamKernelCountsNoTriangleJustBehindARay) {
  const Scene scene = MakeScene(Join(Grid(1, 2, 0), Grid(1, 2, 1)), BuildKind::kBvh);
  std::vector<Ray> rays;
  for (int i = 0; i < 128; ++i) {
    const double at = 0.3 + 0.001 * i;
    const Ray far_away = RayTo({600 + at, 600.2, 0.8}, {at, 0.2, 0.5});
    rays.push_back(i < 64 ? far_away : RayTo({at, 0.2, 2e-6}, {at + 0.01, 0.22, 1}));
  }
  for (const Precision precision : kAllPrecisions) {
    for (const TraceOptions& way : WaysToTrace(precision)) {
      std::vector<std::uint32_t> counts(rays.size());
      ASSERT_TRUE(TraceCount(scene, std::span<const Ray>(rays), way, counts).ok());
      for (std::size_t i = 0; i < rays.size(); ++i) {
        ASSERT_EQ(counts[i], i < 64 ? 0u : 1u) << Describe(way) << ", ray " << i;
      }
    }
  }
}

}  // namespace
}  // namespace kdray::test
