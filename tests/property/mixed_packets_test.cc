// SPDX-License-Identifier: Apache-2.0
// N20 for batches whose rays the kernels group anew: rays from a point, or to a lamp, whose
// directions go through all octants; and large batches of random or shuffled rays, on which several
// ways are tried. Every ray is answered as it is alone.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <random>
#include <span>
#include <vector>

#include "core/base/parallel.h"
#include "core/kernel/ray_order.h"
#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

bool SameBits(const Hit& a, const Hit& b) {
  const auto bits = [](double x) { return std::bit_cast<std::uint64_t>(x); };
  return bits(a.t) == bits(b.t) && bits(a.u) == bits(b.u) && bits(a.v) == bits(b.v) &&
         a.primitive_id == b.primitive_id;
}

/// A camera's tiles of 8 x 8 rays that pass from one octant to another, and rows of neighbouring
/// directions around a point: rays from it, and rays that end in it.
std::vector<RayF> RaysAround(const Vec3f& point, std::mt19937_64& engine) {
  std::vector<RayF> rays;
  for (int i = 0; i < 1024; ++i) {
    const int x = i / 64 % 4 * 8 + i % 8, y = i / 256 * 8 + i / 8 % 8;
    rays.push_back(
        {point,
         0,
         {1, (static_cast<float>(x) - 15.3F) / 200, (static_cast<float>(y) - 12.7F) / 200},
         INFINITY});
  }
  constexpr int kRows = 16, kColumns = 200;
  for (const bool from_point : {true, false}) {
    for (int row = 0; row < kRows; ++row) {
      for (int column = 0; column < kColumns; ++column) {
        const double height = std::acos(1 - (2 * row + 1.0) / kRows);
        const double turn = 2 * 3.14159265358979 * column / kColumns;
        const double far = Uniform(engine, 0.05, 1.5);
        const Vec3f away(Vec3d{std::sin(height) * std::cos(turn), std::sin(height) * std::sin(turn),
                               std::cos(height)} *
                         far);
        const Vec3f end = point + away;
        if (from_point) {
          rays.push_back({point, 0, away, column % 50 == 7 ? 1.0F : INFINITY});
        } else {
          rays.push_back({end, 0, point - end, 1});
        }
      }
    }
  }
  // One that is invalid, one that no packet takes, and one that ends elsewhere.
  rays[2100].direction = {0, 0, 0};
  rays[2700].direction = {0, 0, 1};
  rays[rays.size() - 100].t_max = 0.5F;
  return rays;
}

TEST(N20MixedPackets, RaysAroundAPointAnswerAsAlone) {
  auto engine = RandomEngine(2071);
  for (const MeshData& data :
       {Soup(300, 0.3, 79), RoundToFloat(BumpySphere({0.5, 0.5, 0.5}, 0.6, 60, 90, 0.3)),
        RoundToFloat(Cube({0.5, 0.5, 0.5}, 0.4))}) {
    const Scene scene =
        MakeScene(data, data.triangles.size() == 300 ? BuildKind::kKdSah : BuildKind::kBvh);
    const std::vector<RayF> rays = RaysAround({0.52F, 0.47F, 0.55F}, engine);
    const std::span<const RayF> batch(rays);
    for (const Precision precision : kAllPrecisions) {
      std::vector<Hit> want;
      for (const RayF& ray : rays) {
        want.push_back(ClosestHit(
            scene, {Vec3d(ray.origin), ray.t_min, Vec3d(ray.direction), ray.t_max}, precision));
      }
      for (const TraceOptions& way : WaysToTrace(precision)) {
        std::vector<Hit> hits(rays.size());
        std::vector<std::uint8_t> occluded(rays.size());
        ASSERT_TRUE(TraceClosest(scene, batch, way, hits).ok());
        ASSERT_TRUE(TraceAny(scene, batch, way, occluded).ok());
        for (std::size_t i = 0; i < rays.size(); ++i) {
          ASSERT_TRUE(SameBits(hits[i], want[i])) << Describe(way) << ", ray " << i;
          ASSERT_EQ(occluded[i] != 0, want[i].IsHit()) << Describe(way) << ", ray " << i;
        }
      }
    }
  }
}

Vec3d InCube(std::mt19937_64& engine, double size) {
  const double x = Uniform(engine, -size, size), y = Uniform(engine, -size, size);
  return {x, y, Uniform(engine, -size, size)};
}

// Packets towards a lamp take its place as that of all their ends.
TEST(N20MixedPackets, EndsNearALampAnswerAsAlone) {
  auto engine = RandomEngine(2074);
  const Vec3d lamp{0.53, 0.48, 0.55};
  // Few enough that no packet is abandoned.
  const Scene scene = MakeScene(RoundToFloat(Soup(60, 0.1, 83)), BuildKind::kBvh);
  std::vector<RayF> rays;
  for (int exponent = -27; exponent <= -8; ++exponent) {
    for (int row = 0; row < 40; ++row) {
      const Vec3d towards = InCube(engine, 1);
      for (int i = 0; i < 64; ++i) {
        const Vec3f from(lamp + towards * Uniform(engine, 0.2, 0.9) + InCube(engine, 0.01));
        // The first and the last one are compared before the others are read.
        const bool is_exact = i == 0 || i == 63;
        const Vec3f end(lamp + InCube(engine, is_exact ? 0 : std::ldexp(1, exponent)));
        rays.push_back({from, 0, end - from, 1});
      }
    }
  }
  const std::span<const RayF> batch(rays);
  for (const Precision precision : {Precision::kFast, Precision::kWatertight}) {
    std::vector<std::uint8_t> want;
    for (const RayF& ray : rays) {
      want.push_back(AnyHit(scene, {Vec3d(ray.origin), ray.t_min, Vec3d(ray.direction), ray.t_max},
                            precision));
    }
    EXPECT_GT(std::count(want.begin(), want.end(), 1), 500);
    EXPECT_GT(std::count(want.begin(), want.end(), 0), 500);
    for (const TraceOptions& way : WaysToTrace(precision)) {
      std::vector<std::uint8_t> occluded(rays.size());
      ASSERT_TRUE(TraceAny(scene, batch, way, occluded).ok());
      for (std::size_t i = 0; i < rays.size(); ++i) {
        ASSERT_EQ(occluded[i], want[i]) << Describe(way) << ", ray " << i;
      }
    }
  }
}

TEST(N20MixedPackets, ALargeBatchOfRandomRaysAnswersAsEachKernelDoes) {
  auto engine = RandomEngine(2072);
  const Scene scene = MakeScene(Soup(2000, 0.2, 80), BuildKind::kBvh);
  // So many that kernels are tried (core/kernel/kernel_trial.h).
  const std::vector<Ray> rays =
      RandomRays(scene.mesh->bounds(), (std::size_t{1} << 17) + 77, engine);
  const std::span<const Ray> batch(rays);
  for (const int threads : {1, 3}) {
    Arena arena(threads);
    arena.Run([&] {
      std::vector<std::vector<Hit>> hits;
      std::vector<std::vector<std::uint32_t>> counts;
      const TraceOptions given = With(Precision::kWatertight);
      TraceOptions stream = given, interleaved = given;
      stream.kernel = KernelKind::kStream;
      interleaved.kernel = KernelKind::kInterleaved;
      for (const TraceOptions& way : {given, stream, interleaved}) {
        ASSERT_TRUE(TraceClosest(scene, batch, way, hits.emplace_back(rays.size())).ok());
        ASSERT_TRUE(TraceCount(scene, batch, way, counts.emplace_back(rays.size())).ok());
      }
      for (std::size_t i = 0; i < rays.size(); ++i) {
        ASSERT_TRUE(SameBits(hits[0][i], hits[1][i]) && SameBits(hits[0][i], hits[2][i])) << i;
      }
      EXPECT_EQ(counts[0], counts[1]);
      EXPECT_EQ(counts[0], counts[2]);
    });
  }
}

// Some 2,000 groups of rays (CountGroups): they begin on a plane, on whose both sides triangles
// lie.
std::vector<RayF> ShuffledRays(const Bounds3d& bounds, std::size_t count, bool to_lamp,
                               std::mt19937_64& engine) {
  const Vec3f lamp(bounds.max);
  std::vector<RayF> rays;
  while (rays.size() < count) {
    const Vec3f from(Vec3d{Uniform(engine, bounds.min.x, bounds.max.x),
                           Uniform(engine, bounds.min.y, bounds.max.y),
                           (bounds.min.z + bounds.max.z) / 2});
    const Vec3f along(
        Vec3d{Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)});
    rays.push_back(to_lamp ? RayF{from, 0, lamp - from, 1} : RayF{from, 0, along, INFINITY});
  }
  return rays;
}

TEST(N20MixedPackets, ALargeBatchOfShuffledRaysAnswersSortedAndUnsorted) {
  auto engine = RandomEngine(2073);
  // Large triangles, where unsorted rays are faster, and small ones.
  for (const MeshData& data : {Soup(12, 2, 81), Soup(20000, 0.02, 82)}) {
    const Scene scene = MakeScene(data, BuildKind::kBvh);
    for (const bool to_lamp : {false, true}) {
      // So many that ways are tried (core/trace/shuffled_trace.h).
      const std::vector<RayF> rays =
          ShuffledRays(scene.mesh->bounds(), (std::size_t{1} << 18) + 77, to_lamp, engine);
      const std::span<const RayF> batch(rays);
      ASSERT_TRUE(IsShuffled(batch, scene.mesh->bounds()));
      ASSERT_LT(CountGroups(batch, scene.mesh->bounds()), 4096);
      TraceOptions unsorted = With(Precision::kWatertight);
      unsorted.kernel = KernelKind::kStream;
      unsorted.sort = false;
      std::vector<Hit> want(rays.size());
      std::vector<std::uint8_t> want_occluded(rays.size());
      ASSERT_TRUE(TraceClosest(scene, batch, unsorted, want).ok());
      ASSERT_TRUE(TraceAny(scene, batch, unsorted, want_occluded).ok());
      for (const int threads : {1, 3}) {
        Arena arena(threads);
        arena.Run([&] {
          std::vector<std::atomic<int>> times(rays.size());
          TraceOptions given = With(Precision::kWatertight);
          given.traced = [&](std::size_t first, std::size_t last) {
            for (std::size_t i = first; i < last; ++i) ++times[i];
          };
          std::vector<Hit> hits(rays.size());
          std::vector<std::uint8_t> occluded(rays.size());
          ASSERT_TRUE(TraceClosest(scene, batch, given, hits).ok());
          ASSERT_TRUE(TraceAny(scene, batch, given, occluded).ok());
          for (std::size_t i = 0; i < rays.size(); ++i) {
            ASSERT_TRUE(SameBits(hits[i], want[i])) << i;
            ASSERT_EQ(occluded[i], want_occluded[i]) << i;
            ASSERT_EQ(times[i], 2) << "once for each query, row " << i;
          }
        });
      }
    }
  }
}

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
