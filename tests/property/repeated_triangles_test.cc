// SPDX-License-Identifier: Apache-2.0
// Rays through many triangles of a kd-tree that has them in several leaves: each counts once.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/intersect/precision.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

struct Answers {
  std::vector<std::uint32_t> counts;
  std::vector<Hit> hits;
  std::vector<std::size_t> first;

  friend bool operator==(const Answers&, const Answers&) = default;
};
Answers AnswersOf(const Scene& scene, const std::vector<Ray>& rays, const TraceOptions& way) {
  Answers answers;
  answers.counts.resize(rays.size());
  EXPECT_TRUE(TraceCount(scene, std::span<const Ray>(rays), way, answers.counts).ok());
  const AllHits all = TraceAll(scene, std::span<const Ray>(rays), way, 1'000).value();
  answers.hits.assign(all.hits.begin(), all.hits.end());
  answers.first = all.first;
  return answers;
}

TEST(RepeatedTriangles, CountOnceOnRaysThroughHundreds) {
  auto engine = RandomEngine(2207);
  // Triangles as large as the cube that they fill.
  const MeshData data = RoundToFloat(Soup(1'500, 1.0, 2207));
  const Scene plain = MakeScene(data, BuildKind::kBox);
  const std::vector<Ray> rays = RandomRays(plain.mesh->bounds(), 40, engine);
  for (const Precision precision : kAllPrecisions) {
    const std::vector<TraceOptions> ways = WaysToTrace(precision);
    const Answers want = AnswersOf(plain, rays, ways[0]);
    ASSERT_GT(*std::max_element(want.counts.begin(), want.counts.end()), 100u);
    for (const BuildKind build : {BuildKind::kKdSah, BuildKind::kKdMedian}) {
      const Scene scene = MakeScene(data, build);
      for (const TraceOptions& way : ways) {
        ASSERT_EQ(AnswersOf(scene, rays, way), want)
            << Name(build) << ", " << Name(precision) << ", " << Describe(way);
      }
    }
  }
}

}  // namespace
}  // namespace kdray::test
