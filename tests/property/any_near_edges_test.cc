// SPDX-License-Identifier: Apache-2.0
// N20 for any hit where kernels may answer by bounds instead of the triangle intersection: rays
// that pass edges closely, and rays whose interval ends or begins near a triangle; one by one, from
// a point, and to a lamp. Every ray is answered as it is alone.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

/// Triangles with sides from 1/2 to 2^-12 in a cube of 2; few, so that most rays meet only the one
/// they are aimed at.
MeshData TrianglesOfAllSizes(std::mt19937_64& engine) {
  MeshData data;
  const Bounds3d cube{{-1, -1, -1}, {1, 1, 1}};
  for (std::uint32_t i = 0; i < 96; ++i) {
    const double size = std::ldexp(1, -1 - static_cast<int>(i / 8));
    const Vec3d at = PointIn({cube.min * 0.5, cube.max * 0.5}, engine);
    for (int corner = 0; corner < 3; ++corner) {
      data.vertices.push_back(at + PointIn(cube, engine) * size);
    }
    data.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  return data;
}

/// A point beside an edge of a triangle, within or without: `off` times its size away from the
/// edge.
Vec3d BesideEdge(const MeshData& data, std::size_t triangle, int edge, double off,
                 std::mt19937_64& engine) {
  const auto corner = [&](int k) {
    return data.vertices[data.triangles[triangle][static_cast<std::size_t>((edge + k) % 3)]];
  };
  const Vec3d a = corner(0);
  return a + (corner(1) - a) * off + (corner(2) - a) * Uniform(engine, 0.1, 0.6);
}

/// From -2^-k to 2^-k, k going through 0, ..., 27.
double Nearness(std::size_t number, std::mt19937_64& engine) {
  return std::ldexp(Uniform(engine, -1, 1), -static_cast<int>(number % 28));
}

std::size_t PickTriangle(const MeshData& data, std::mt19937_64& engine) {
  const double size = static_cast<double>(data.triangles.size());
  return static_cast<std::size_t>(Uniform(engine, 0, size - 0.01));
}

/// Half as near as `far` at least.
Vec3d FarPoint(double far, std::mt19937_64& engine) {
  const double size = Uniform(engine, far / 2, far);
  return PointIn({{-size, -size, -size}, {size, size, size}}, engine);
}

/// Rays beside edges; every third one passes within the triangle, and its interval ends or begins
/// near it. They begin among the triangles, or up to four times as far away.
std::vector<Ray> RaysBesideEdges(const MeshData& data, std::size_t count, std::mt19937_64& engine) {
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const std::size_t i = rays.size();
    const double near = Nearness(i, engine);
    const bool is_at_end = i % 3 == 0;
    const Vec3d target = BesideEdge(data, PickTriangle(data, engine), static_cast<int>(i % 3),
                                    is_at_end ? 0.3 : near, engine);
    const Vec3d origin = FarPoint(i % 5 == 0 ? 4 : 1, engine);
    Ray ray{origin, 0, target - origin, INFINITY};
    if (is_at_end) (i % 2 == 0 ? ray.t_max : ray.t_min) = 1 + near;
    rays.push_back(ray);
  }
  return rays;
}

/// Sets of 64 rays beside the edges of one triangle, from one point or to one lamp. From a point,
/// every third ray is as above.
std::vector<Ray> PacketsBesideEdges(const MeshData& data, std::size_t packets,
                                    std::mt19937_64& engine) {
  std::vector<Ray> rays;
  for (std::size_t packet = 0; packet < packets; ++packet) {
    const std::size_t triangle = PickTriangle(data, engine);
    const Vec3d point = FarPoint(packet % 5 == 0 ? 3 : 1, engine);
    for (std::size_t i = 0; i < 64; ++i) {
      const double near = Nearness(packet / 2 + i / 16, engine);
      const bool is_at_end = packet % 2 == 0 && i % 3 == 0;
      const Vec3d target =
          BesideEdge(data, triangle, static_cast<int>(i % 3), is_at_end ? 0.3 : near, engine);
      if (packet % 2 == 0) {
        rays.push_back({point, 0, target - point, is_at_end ? 1 + near : 1e30});
      } else {
        const Vec3d origin = point + (target - point) * Uniform(engine, 1.1, 1.5);
        rays.push_back({origin, 0, point - origin, 1});
      }
    }
  }
  return rays;
}

std::vector<RayF> RoundedRays(const std::vector<Ray>& rays) {
  std::vector<RayF> rounded;
  rounded.reserve(rays.size());
  for (const Ray& ray : rays) {
    rounded.push_back({Vec3f(ray.origin), static_cast<float>(ray.t_min), Vec3f(ray.direction),
                       static_cast<float>(ray.t_max)});
  }
  return rounded;
}

template <class Number>
void ExpectAnswersAsAlone(const Scene& scene, const std::vector<RayOf<Number>>& rays) {
  for (const Precision precision : kAllPrecisions) {
    std::vector<std::uint8_t> want;
    for (const auto& [origin, t_min, direction, t_max] : rays) {
      const Ray ray{Vec3d(origin), static_cast<double>(t_min), Vec3d(direction),
                    static_cast<double>(t_max)};
      want.push_back(AnyHit(scene, ray, precision) ? 1 : 0);
    }
    const auto fourth = static_cast<std::ptrdiff_t>(rays.size() / 4);
    EXPECT_GT(std::count(want.begin(), want.end(), 1), fourth);
    EXPECT_GT(std::count(want.begin(), want.end(), 0), fourth);
    for (const TraceOptions& way : WaysToTrace(precision)) {
      std::vector<std::uint8_t> occluded(rays.size());
      ASSERT_TRUE(TraceAny(scene, std::span(rays), way, occluded).ok());
      for (std::size_t i = 0; i < rays.size(); ++i) {
        ASSERT_EQ(occluded[i], want[i]) << Describe(way) << ", ray " << i;
      }
    }
  }
}

void ExpectAnswersAsAlone(const MeshData& data, const std::vector<Ray>& rays) {
  const Scene scene = MakeScene(data, BuildKind::kBvh);
  ExpectAnswersAsAlone(scene, rays);
  ExpectAnswersAsAlone(scene, RoundedRays(rays));
}

TEST(N20AnyHit, RaysBesideEdgesAnswerAsAlone) {
  auto engine = RandomEngine(2075);
  const MeshData doubles = TrianglesOfAllSizes(engine);
  for (const MeshData& data : {RoundToFloat(doubles), doubles}) {
    ExpectAnswersAsAlone(data, RaysBesideEdges(data, 20'000, engine));
  }
}

TEST(N20AnyHit, PacketsBesideEdgesAnswerAsAlone) {
  auto engine = RandomEngine(2076);
  const MeshData doubles = TrianglesOfAllSizes(engine);
  for (const MeshData& data : {RoundToFloat(doubles), doubles}) {
    ExpectAnswersAsAlone(data, PacketsBesideEdges(data, 1'000, engine));
  }
}

}  // namespace
}  // namespace kdray::test
