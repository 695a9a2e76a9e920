// SPDX-License-Identifier: Apache-2.0
// N20: an answer depends on the ray, the mesh and the precision, and on nothing else: not on the
// build, the threads, how a batch is cut, the kernel, the width of its vectors, nor on whether the
// tree was just built or came from memory or disk. tests/integration/same_answers_test.cc goes on
// with forms of request.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/library/tree_library.h"
#include "core/trace/brute_force.h"
#include "core/trace/trace.h"
#include "tests/property/closed_meshes.h"
#include "tests/property/scenes.h"
#include "tests/support/off_text.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_folder.h"

namespace kdray::test {
namespace {

using namespace core;

struct Answers {
  std::vector<Hit> hits;
  std::vector<std::uint8_t> occluded;
};

/// In batches of `piece` rays.
template <class AnyRay>
Answers Trace(const Scene& scene, const std::vector<AnyRay>& rays, const TraceOptions& way,
              std::size_t piece) {
  Answers answers{std::vector<Hit>(rays.size()), std::vector<std::uint8_t>(rays.size())};
  for (std::size_t first = 0; first < rays.size(); first += piece) {
    const std::size_t count = std::min(piece, rays.size() - first);
    const auto batch = std::span<const AnyRay>(rays).subspan(first, count);
    EXPECT_TRUE(
        TraceClosest(scene, batch, way, std::span(answers.hits).subspan(first, count)).ok());
    EXPECT_TRUE(
        TraceAny(scene, batch, way, std::span(answers.occluded).subspan(first, count)).ok());
  }
  return answers;
}

/// Bit for bit, NaN and signs of zeros included.
bool SameBits(std::span<const Hit> a, std::span<const Hit> b) {
  if (a.size() != b.size()) return false;
  const auto bits = [](const Hit& h) {
    return std::array{std::bit_cast<std::uint64_t>(h.t), std::bit_cast<std::uint64_t>(h.u),
                      std::bit_cast<std::uint64_t>(h.v),
                      static_cast<std::uint64_t>(h.primitive_id)};
  };
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (bits(a[i]) != bits(b[i])) return false;
  }
  return true;
}

/// Random, degenerate and invalid rays; float rays, so both forms represent them.
std::vector<RayF> MixedRays(const ClosedMesh& mesh, std::size_t each) {
  auto engine = RandomEngine(2000);
  std::vector<Ray> rays = RandomRays(mesh.scene.mesh->bounds(), each, engine);
  for (const auto& family : {VertexRays, EdgeRays, AxisRaysThroughVertices}) {
    for (const Ray& ray : family(mesh, each, engine)) rays.push_back(ray);
  }
  std::shuffle(rays.begin(), rays.end(), engine);
  std::vector<RayF> floats;
  for (const Ray& ray : rays) {
    RayF narrow{Vec3f(ray.origin), 0, Vec3f(ray.direction), INFINITY};
    if (floats.size() % 5 == 1) narrow.t_max = 0.75F;
    if (floats.size() % 97 == 3) narrow.direction = {0, 0, 0};
    floats.push_back(narrow);
  }
  return floats;
}

std::vector<Ray> Widened(const std::vector<RayF>& rays) {
  std::vector<Ray> wide;
  for (std::size_t i = 0; i < rays.size(); ++i)
    wide.push_back(RayBatch(std::span<const RayF>(rays))[i]);
  return wide;
}

/// The rays have these answers with every kernel on every level, as floats and as doubles.
void ExpectInEveryWay(const Scene& scene, const std::vector<RayF>& rays, Precision precision,
                      const Answers& want) {
  const std::vector<Ray> wide = Widened(rays);
  for (const TraceOptions& way : WaysToTrace(precision)) {
    const Answers got = Trace(scene, rays, way, rays.size());
    ASSERT_TRUE(SameBits(got.hits, want.hits)) << Describe(way);
    ASSERT_EQ(got.occluded, want.occluded) << Describe(way);
    const Answers of_doubles = Trace(scene, wide, way, wide.size());
    ASSERT_TRUE(SameBits(of_doubles.hits, want.hits)) << Describe(way);
    ASSERT_EQ(of_doubles.occluded, want.occluded) << Describe(way);
  }
}

std::vector<MeshData> Meshes() {
  return {RoundToFloat(BumpySphere({0.3, -0.2, 0.1}, 1, 16, 24, 0.3)),
          UvSphere({448'251.25, 5'411'932.5, 122.75}, 10, 12, 20), Cube({0.5, 0.5, 0.5}, 0.5)};
}

/// Rays that packets are made of: tiles of a camera's picture, some aimed at the very vertices and
/// middles of edges, some with an interval of their own; and to a light from where those tiles hit.
std::vector<RayF> PacketRays(const MeshData& data, const Bounds3d& bounds,
                             std::mt19937_64& engine) {
  std::vector<RayF> rays;
  const Vec3d center = bounds.Center();
  const double size = Length(bounds.Extent());
  for (int view = 0; view < 6; ++view) {
    const Vec3f eye(center + Normalized(Vec3d{Uniform(engine, -1, 1), Uniform(engine, -1, 1),
                                              Uniform(engine, -1, 1)}) *
                                 (size * (view == 0 ? 20 : Uniform(engine, 0.4, 1.5))));
    const Vec3d forward = center - Vec3d(eye);
    const Vec3d right = Normalized(Cross(forward, Vec3d{0.1, 1, 0.2})) * size;
    const Vec3d up = Normalized(Cross(right, forward)) * size;
    const Vec3f light(center + Vec3d{0.3, 0.7, 0.4} * size);
    for (int tile = 0; tile < 6; ++tile) {
      const double x0 = Uniform(engine, -0.5, 0.5), y0 = Uniform(engine, -0.5, 0.5);
      const double pixel = tile % 2 == 0 ? 0.002 : 0.01;
      const std::size_t first = rays.size();
      for (int i = 0; i < 64; ++i) {
        const Vec3d at = forward + right * (x0 + pixel * (i % 8)) + up * (y0 + pixel * (i / 8));
        rays.push_back({eye, 0, Vec3f(at), INFINITY});
      }
      // The vertices and edges that these pixels see.
      std::vector<Vec3d> seen;
      for (const TriangleIndices& t : data.triangles) {
        const Vec3d a = data.vertices[t[0]], b = data.vertices[t[1]];
        for (const Vec3d& point : {a, a * 0.5 + b * 0.5}) {
          const Vec3d to = point - Vec3d(eye);
          const Vec3d on_plane = to * (Dot(forward, forward) / Dot(to, forward)) - forward;
          const double x = (Dot(on_plane, right) / Dot(right, right) - x0) / pixel;
          const double y = (Dot(on_plane, up) / Dot(up, up) - y0) / pixel;
          if (!(x > -0.5 && x < 7.5 && y > -0.5 && y < 7.5) || Dot(to, forward) <= 0) continue;
          const std::size_t i = static_cast<std::size_t>(std::lround(x) + 8 * std::lround(y));
          rays[first + i].direction = Vec3f(point) - eye;
          seen.push_back(point);
        }
      }
      if (tile == 4) {
        for (std::size_t i = first; i < rays.size(); i += 3) {
          rays[i].t_min = static_cast<float>(Uniform(engine, 0, 1));
          rays[i].t_max = static_cast<float>(Uniform(engine, 1, 2));
        }
      }
      for (std::size_t i = first; i < first + 64; ++i) {
        Vec3f start = rays[i].origin + rays[i].direction * 0.9F;
        // Through a vertex or an edge, from beyond it; or from it.
        if (i % 2 == 1 && !seen.empty()) {
          const Vec3d point = seen[i % seen.size()];
          start = Vec3f(Vec3d(light) + (point - Vec3d(light)) * (i % 4 == 1 ? 1.25 : 1.0));
        }
        rays.push_back({start, tile == 5 ? 0.125F : 0, light - start, 1});
      }
    }
  }
  return rays;
}

/// Walls of a room, each of two large triangles, with others in front of them at distances from a
/// thousandth down to none.
MeshData ThinWalls() {
  MeshData data;
  const auto wall = [&](int axis, double at, double half) {
    const auto first = static_cast<std::uint32_t>(data.vertices.size());
    for (unsigned i = 0; i < 4; ++i) {
      Vec3d corner;
      corner[axis] = at;
      corner[(axis + 1) % 3] = (i & 1) != 0 ? half : -half;
      corner[(axis + 2) % 3] = (i & 2) != 0 ? half : -half;
      data.vertices.push_back(Vec3d(Vec3f(corner)));
    }
    data.triangles.push_back({first, first + 1, first + 3});
    data.triangles.push_back({first + 3, first + 2, first});
  };
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      wall(axis, side, 1);
      wall(axis, side, 0.75);
      for (int bits = 10; bits < 25; bits += 2) {
        wall(axis, side * (1 - std::ldexp(1.0, -bits)), 1 - std::ldexp(bits, -6));
      }
    }
  }
  data.single_precision = true;
  return data;
}

TEST(N20SameBytes, APacketAnswersAsItsRaysAloneDo) {
  auto engine = RandomEngine(2064);
  std::vector<MeshData> meshes = Meshes();
  meshes.push_back(RoundToFloat(BumpySphere({0, 0, 0}, 1, 60, 90, 0.3)));
  meshes.push_back(Soup(300, 0.3, 77));
  meshes.push_back(ThinWalls());
  for (const MeshData& data : meshes) {
    const Scene scene = MakeScene(data, BuildKind::kKdSah);
    const std::vector<RayF> rays = PacketRays(data, scene.mesh->bounds(), engine);
    const std::vector<Ray> wide = Widened(rays);
    for (const Precision precision : kAllPrecisions) {
      Answers want;
      for (const Ray& ray : wide) {
        want.hits.push_back(ClosestHit(scene, ray, precision));
        want.occluded.push_back(want.hits.back().IsHit() ? 1 : 0);
      }
      ASSERT_NO_FATAL_FAILURE(ExpectInEveryWay(scene, rays, precision, want));
    }
  }
}

TEST(N20SameBytes, APacketThatCullsAnswersAsBruteForceDoes) {
  auto engine = RandomEngine(2065);
  std::vector<MeshData> meshes = Meshes();
  meshes.push_back(Soup(300, 0.3, 78));
  meshes.push_back(ThinWalls());
  for (const MeshData& data : meshes) {
    const Scene scene = MakeScene(data, BuildKind::kKdSah);
    const std::vector<RayF> rays = PacketRays(data, scene.mesh->bounds(), engine);
    const std::vector<Ray> wide = Widened(rays);
    for (const Precision precision : {Precision::kFast, Precision::kWatertight}) {
      for (const Cull cull : {Cull::kBack, Cull::kFront}) {
        Answers want;
        for (const Ray& ray : wide) {
          want.hits.push_back(BruteForceClosest(*scene.mesh, ray, precision, {.cull = cull}));
          want.occluded.push_back(want.hits.back().IsHit() ? 1 : 0);
        }
        for (TraceOptions way : WaysToTrace(precision)) {
          way.cull = cull;
          const Answers got = Trace(scene, rays, way, rays.size());
          ASSERT_TRUE(SameBits(got.hits, want.hits)) << Describe(way) << Name(cull);
          ASSERT_EQ(got.occluded, want.occluded) << Describe(way) << Name(cull);
        }
      }
    }
  }
}

/// Packets of 64 rays from one point of the surface: a vertex, a point of an edge, or one inside a
/// triangle, as near as floats come.
std::vector<RayF> RaysFromTheSurface(const MeshData& data, std::size_t packets,
                                     std::mt19937_64& engine) {
  std::vector<RayF> rays;
  for (std::size_t packet = 0; packet < packets; ++packet) {
    const TriangleIndices& t = data.triangles[engine() % data.triangles.size()];
    const Vec3d a = data.vertices[t[0]], b = data.vertices[t[1]], c = data.vertices[t[2]];
    const Vec3f origin(packet % 3 == 0   ? a
                       : packet % 3 == 1 ? (a + b) * 0.5
                                         : a * 0.25 + b * 0.25 + c * 0.5);
    const auto eighth = [&] { return static_cast<float>(static_cast<int>(engine() % 17) - 8) / 8; };
    const auto step = [&] { return static_cast<float>(static_cast<int>(engine() % 9) - 4) / 512; };
    const Vec3f direction{eighth(), eighth(), eighth()};
    const Vec3f right{step(), step(), step()}, up{step(), step(), step()};
    for (int i = 0; i < 64; ++i) {
      const Vec3f d =
          direction + right * static_cast<float>(i % 8) + up * static_cast<float>(i / 8);
      rays.push_back({origin, 0, d, packet % 4 == 3 ? 1 : INFINITY});
    }
  }
  return rays;
}

TEST(N20SameBytes, OriginsOnTheSurfaceChangeNoBitAndGiveNoNegativeZero) {
  auto engine = RandomEngine(2080);
  // Coordinates of few bits, so that origins lie exactly on the triangles' planes.
  MeshData few_bits;
  few_bits.vertices = {{0, 0, 0},    {1, 0, 0},       {0, 1, 0},
                       {1, 1, 0.25}, {0.25, 0.25, 1}, {0.75, 0.5, 1}};
  few_bits.triangles = {{0, 1, 2}, {1, 3, 2}, {0, 2, 1}, {4, 5, 3}, {0, 1, 4}, {2, 4, 0}};
  std::vector<MeshData> meshes = Meshes();
  meshes.push_back(few_bits);
  for (const MeshData& data : meshes) {
    const Scene scene = MakeScene(data, BuildKind::kKdSah);
    const std::vector<RayF> rays = RaysFromTheSurface(data, 24, engine);
    const std::vector<Ray> wide = Widened(rays);
    for (const Precision precision : kAllPrecisions) {
      Answers want;
      for (const Ray& ray : wide) {
        want.hits.push_back(BruteForceClosest(*scene.mesh, ray, precision));
        want.occluded.push_back(want.hits.back().IsHit() ? 1 : 0);
        const Hit& hit = want.hits.back();
        for (const double number : {hit.t, hit.u, hit.v}) {
          ASSERT_FALSE(number == 0 && std::signbit(number)) << Name(precision);
        }
      }
      for (const TraceOptions& way : WaysToTrace(precision)) {
        for (const std::size_t piece : {std::size_t{1}, std::size_t{64}, rays.size()}) {
          if (piece == 1 && way.kernel) continue;  // as the usual way, but slowly
          const Answers got = Trace(scene, rays, way, piece);
          ASSERT_TRUE(SameBits(got.hits, want.hits)) << Describe(way) << ", batches of " << piece;
          ASSERT_EQ(got.occluded, want.occluded) << Describe(way);
        }
        const Answers of_doubles = Trace(scene, wide, way, wide.size());
        ASSERT_TRUE(SameBits(of_doubles.hits, want.hits)) << Describe(way);
        ASSERT_EQ(of_doubles.occluded, want.occluded) << Describe(way);
      }
    }
  }
}

/// Triangles around, beside and behind an eye, whose planes pass it at distances down to none.
MeshData PlanesPastAnEye(const Vec3d& eye, std::mt19937_64& engine) {
  MeshData data;
  const auto any = [&] {
    return Vec3d{Uniform(engine, -1, 1), Uniform(engine, -1, 1), Uniform(engine, -1, 1)};
  };
  for (int i = 0; i < 96; ++i) {
    const Vec3d normal = Normalized(any());
    const int bits = i % 8 * 4;
    const double distance = bits == 28 ? 0 : std::ldexp(i % 16 < 8 ? 0.5 : -0.5, -bits);
    const double size = std::ldexp(1.0, -(i / 16));
    const auto first = static_cast<std::uint32_t>(data.vertices.size());
    for (int c = 0; c < 3; ++c) {
      data.vertices.push_back(eye + normal * distance + Cross(normal, any()) * size);
    }
    data.triangles.push_back({first, first + 1, first + 2});
  }
  return RoundToFloat(std::move(data));
}

TEST(N20SameBytes, TrianglesAroundAndBehindAnEyeChangeNoBit) {
  auto engine = RandomEngine(2081);
  const Vec3f eye{0.25F, -0.5F, 0.125F};
  const Scene scene = MakeScene(PlanesPastAnEye(Vec3d(eye), engine), BuildKind::kBvh);
  std::vector<RayF> rays;
  for (int packet = 0; packet < 48; ++packet) {
    const auto any = [&](double size) {
      return Vec3f(Vec3d{Uniform(engine, -size, size), Uniform(engine, -size, size),
                         Uniform(engine, -size, size)});
    };
    const Vec3f direction = any(1), right = any(0.02), up = any(0.02);
    const float t_min = packet % 4 == 2 ? -1.0F : 0.0F;
    for (int i = 0; i < 64; ++i) {
      const Vec3f d =
          direction + right * static_cast<float>(i % 8) + up * static_cast<float>(i / 8);
      const Vec3f start = eye + d * 1.5F;
      rays.push_back(packet % 2 == 0 ? RayF{eye, t_min, d, INFINITY}
                                     : RayF{start, 0, eye - start, 1});
    }
  }
  const std::vector<Ray> wide = Widened(rays);
  for (const Precision precision : kAllPrecisions) {
    Answers want;
    for (const Ray& ray : wide) {
      want.hits.push_back(BruteForceClosest(*scene.mesh, ray, precision));
      want.occluded.push_back(want.hits.back().IsHit() ? 1 : 0);
    }
    ASSERT_NO_FATAL_FAILURE(ExpectInEveryWay(scene, rays, precision, want));
  }
}

TEST(N20SameBytes, BuildThreadsBatchAndKernelChangeNoBit) {
  for (const MeshData& data : Meshes()) {
    const ClosedMesh mesh = MakeClosedMesh("mesh", data);
    const std::vector<RayF> floats = MixedRays(mesh, 200);
    const std::vector<Ray> rays = Widened(floats);
    for (const Precision precision : kAllPrecisions) {
      Answers want;
      for (const Ray& ray : rays) {
        want.hits.push_back(BruteForceClosest(*mesh.scene.mesh, ray, precision));
        want.occluded.push_back(want.hits.back().IsHit() ? 1 : 0);
      }
      const std::vector<Scene> scenes = MakeScenes(data);
      const std::vector<TraceOptions> ways = WaysToTrace(precision);
      for (std::size_t s = 0; s < scenes.size(); ++s) {
        const Scene& scene = scenes[s];
        for (std::size_t w = 0; w < ways.size(); ++w) {
          // The usual way with everything; each kernel on each level with one build, one number of
          // threads and one piece.
          const bool usual = w == 0;
          if (!usual && w % scenes.size() != s) continue;
          const TraceOptions& way = ways[w];
          for (const int threads : usual ? std::vector{1, 2, 5} : std::vector{2}) {
            Arena arena(threads);
            arena.Run([&] {
              const std::size_t all = rays.size();
              for (const std::size_t piece :
                   usual ? std::vector<std::size_t>{1, 13, all} : std::vector<std::size_t>{97}) {
                for (const Answers& got :
                     {Trace(scene, rays, way, piece), Trace(scene, floats, way, piece)}) {
                  ASSERT_TRUE(SameBits(got.hits, want.hits))
                      << Name(scene.tree->build) << ", " << Describe(way) << ", " << threads
                      << " threads, batches of " << piece;
                  ASSERT_EQ(got.occluded, want.occluded);
                }
              }
            });
            if (HasFatalFailure()) return;
          }
        }
      }
    }
  }
}

TEST(N20SameBytes, CountsAndCrossingsDependOnNeitherBuildNorThreadsNorBatch) {
  for (const MeshData& data : Meshes()) {
    const ClosedMesh mesh = MakeClosedMesh("mesh", data);
    const std::vector<Ray> rays = Widened(MixedRays(mesh, 300));
    const AllHits want =
        TraceAll(mesh.scene, std::span<const Ray>(rays), With(Precision::kExact), 64).value();
    for (const Scene& scene : MakeScenes(data)) {
      for (const int threads : {1, 5}) {
        Arena arena(threads);
        arena.Run([&] {
          const AllHits got =
              TraceAll(scene, std::span<const Ray>(rays), With(Precision::kExact), 64).value();
          ASSERT_TRUE(SameBits(got.hits, want.hits)) << Name(scene.tree->build);
          ASSERT_EQ(got.first, want.first);
          std::vector<std::uint32_t> count(1);
          for (std::size_t i = 0; i < rays.size(); i += 7) {
            ASSERT_TRUE(TraceCount(scene, std::span<const Ray>(rays).subspan(i, 1),
                                   With(Precision::kExact), count)
                            .ok());
            ASSERT_EQ(count[0], want.first[i + 1] - want.first[i]);
          }
        });
        if (HasFatalFailure()) return;
      }
    }
  }
}

TEST(N20SameBytes, ATreeJustBuiltOneInMemoryAndOneFromDiskAnswerTheSame) {
  for (const MeshData& data : Meshes()) {
    const ClosedMesh mesh = MakeClosedMesh("mesh", data);
    const std::vector<RayF> floats = MixedRays(mesh, 200);
    const std::vector<std::byte> file = OffBytes(data);
    const TemporaryFolder folder;
    LibraryOptions options;
    options.data_dir = folder.path() / "data";
    std::map<BuildKind, TreeId> ids;
    for (const bool from_disk : {false, true}) {
      const auto library = TreeLibrary::Open(options).value();
      for (const BuildKind build : kAllBuildKinds) {
        if (!from_disk) {
          auto upload = library->BeginUpload(file.size()).value();
          ASSERT_TRUE(upload.Append(file).ok());
          ids[build] = library->Finish(std::move(upload), build).value().id;
        }
        for (int use = 0; use < 2; ++use) {  // the second time it is in memory
          const Scene scene = library->Load(ids[build], {}).value();
          for (const Precision precision : kAllPrecisions) {
            const Answers want = Trace(mesh.scene, floats, With(precision), floats.size());
            const Answers got = Trace(scene, floats, With(precision), floats.size());
            ASSERT_TRUE(SameBits(got.hits, want.hits)) << Name(build) << ", " << Name(precision);
            ASSERT_EQ(got.occluded, want.occluded);
          }
        }
      }
      library->Shutdown();
      const LibraryCounters counters = library->counters();
      EXPECT_EQ(counters.builds, from_disk ? 0 : kAllBuildKinds.size());
      EXPECT_EQ(counters.loads, from_disk ? kAllBuildKinds.size() : 0);
    }
  }
}

}  // namespace
}  // namespace kdray::test
