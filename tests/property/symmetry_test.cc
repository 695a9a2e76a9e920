// SPDX-License-Identifier: Apache-2.0
// N06: turning, mirroring or renumbering a mesh changes no answer but in the names of things.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <set>

#include "core/trace/trace.h"
#include "tests/property/closed_meshes.h"
#include "tests/property/scenes.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using namespace core;

// `fast` is left out: its arithmetic prefers an axis and a corner.
constexpr std::array kSymmetric = {Precision::kWatertight, Precision::kDouble, Precision::kExact};

struct Subject {
  ClosedMesh mesh;
  std::vector<Ray> rays;
  std::vector<std::vector<Hit>> hits;  // of each of kSymmetric
  std::vector<std::uint32_t> counts;
};

std::vector<Hit> Closest(const Scene& scene, const std::vector<Ray>& rays, Precision precision) {
  std::vector<Hit> hits(rays.size());
  EXPECT_TRUE(TraceClosest(scene, std::span<const Ray>(rays), With(precision), hits).ok());
  return hits;
}
std::vector<std::uint32_t> Counts(const Scene& scene, const std::vector<Ray>& rays) {
  std::vector<std::uint32_t> counts(rays.size());
  EXPECT_TRUE(TraceCount(scene, std::span<const Ray>(rays), With(Precision::kExact), counts).ok());
  return counts;
}

const Subject& TheSubject() {
  static const Subject subject = [] {
    auto engine = RandomEngine(600);
    Subject s{
        MakeClosedMesh("bumpy sphere", RoundToFloat(BumpySphere({0.3, -0.2, 0.1}, 1, 24, 40, 0.3))),
        {},
        {},
        {}};
    s.rays = RandomRays(s.mesh.scene.mesh->bounds(), 2'000, engine);
    for (const Ray& ray : VertexRays(s.mesh, 2'000, engine)) s.rays.push_back(ray);
    for (const Ray& ray : EdgeRays(s.mesh, 2'000, engine)) s.rays.push_back(ray);
    for (const Precision precision : kSymmetric)
      s.hits.push_back(Closest(s.mesh.scene, s.rays, precision));
    s.counts = Counts(s.mesh.scene, s.rays);
    return s;
  }();
  return subject;
}

/// The vertices that the hit point leans on: one at a corner, two on an edge.
std::set<std::uint32_t> HitVertices(const MeshData& data, const Hit& hit) {
  std::set<std::uint32_t> vertices;
  const TriangleIndices& t = data.triangles[hit.primitive_id];
  constexpr double kNearlyNothing = 1e-12;  // weights are rounded
  if (hit.u > kNearlyNothing) vertices.insert(t[1]);
  if (hit.v > kNearlyNothing) vertices.insert(t[2]);
  if (1 - hit.u - hit.v > kNearlyNothing) vertices.insert(t[0]);
  return vertices;
}

/// `original[id]` is the number that triangle `id` of `data` has in the subject's mesh.
/// `keeps_order`: equal t go to the same triangle then.
void ExpectSame(const MeshData& data, const std::vector<Ray>& rays,
                const std::vector<PrimitiveId>& original, bool keeps_order) {
  const Subject& subject = TheSubject();
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  for (std::size_t p = 0; p < kSymmetric.size(); ++p) {
    const std::vector<Hit> hits = Closest(scene, rays, kSymmetric[p]);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const Hit &hit = hits[i], &want = subject.hits[p][i];
      ASSERT_EQ(hit.t, want.t) << Name(kSymmetric[p]) << ", ray " << i;
      if (!hit.IsHit()) continue;
      if (keeps_order) {
        ASSERT_EQ(original[hit.primitive_id], want.primitive_id)
            << Name(kSymmetric[p]) << ", ray " << i;
      }
      if (kSymmetric[p] == Precision::kExact) {
        ASSERT_EQ(HitVertices(data, hit), HitVertices(subject.mesh.data, want)) << "ray " << i;
      }
    }
  }
  const std::vector<std::uint32_t> counts = Counts(scene, rays);
  for (std::size_t i = 0; i < rays.size(); ++i)
    ASSERT_EQ(counts[i] % 2, subject.counts[i] % 2) << "ray " << i;
}

std::vector<PrimitiveId> AllTriangles() {
  std::vector<PrimitiveId> ids(TheSubject().mesh.data.triangles.size());
  std::iota(ids.begin(), ids.end(), 0u);
  return ids;
}

TEST(N06Symmetry, PermutedAndMirroredAxesChangeNoAnswer) {
  std::array<int, 3> axes = {0, 1, 2};
  int mirror = 0;
  do {
    for (int k = 0; k < 2; ++k) {
      mirror = (mirror + 3) % 8;  // some mirror for each permutation
      const auto turned = [&](const Vec3d& v) {
        Vec3d w;
        for (int i = 0; i < 3; ++i) {
          const double value = v[axes[static_cast<std::size_t>(i)]];
          w[i] = (mirror >> i & 1) != 0 ? -value : value;
        }
        return w;
      };
      MeshData data = TheSubject().mesh.data;
      for (Vec3d& v : data.vertices) v = turned(v);
      std::vector<Ray> rays = TheSubject().rays;
      for (Ray& ray : rays) {
        ray.origin = turned(ray.origin);
        ray.direction = turned(ray.direction);
      }
      ExpectSame(data, rays, AllTriangles(), true);
      if (HasFatalFailure()) return;
    }
  } while (std::next_permutation(axes.begin(), axes.end()));
}

TEST(N06Symmetry, TurnedAndReversedTrianglesChangeNoAnswer) {
  auto engine = RandomEngine(601);
  MeshData data = TheSubject().mesh.data;
  for (TriangleIndices& t : data.triangles) {
    std::rotate(t.begin(), t.begin() + static_cast<std::ptrdiff_t>(engine() % 3), t.end());
    if (engine() % 2 == 0) std::swap(t[0], t[1]);
  }
  ExpectSame(data, TheSubject().rays, AllTriangles(), true);
}

TEST(N06Symmetry, ShuffledTrianglesChangeNothingButNumbers) {
  auto engine = RandomEngine(602);
  std::vector<PrimitiveId> original = AllTriangles();
  std::shuffle(original.begin(), original.end(), engine);
  MeshData data = TheSubject().mesh.data;
  for (std::size_t i = 0; i < original.size(); ++i)
    data.triangles[i] = TheSubject().mesh.data.triangles[original[i]];
  ExpectSame(data, TheSubject().rays, original, false);
}

TEST(N06Symmetry, OfDuplicatesTheFirstIsHitAndEachIsCrossed) {
  const Subject& subject = TheSubject();
  MeshData data = subject.mesh.data;
  data.triangles.insert(data.triangles.end(), subject.mesh.data.triangles.begin(),
                        subject.mesh.data.triangles.end());
  const Scene scene = MakeScene(data, BuildKind::kKdSah);
  for (std::size_t p = 0; p < kSymmetric.size(); ++p)
    EXPECT_EQ(Closest(scene, subject.rays, kSymmetric[p]), subject.hits[p]);
  const std::vector<std::uint32_t> counts = Counts(scene, subject.rays);
  for (std::size_t i = 0; i < counts.size(); ++i) ASSERT_EQ(counts[i], 2 * subject.counts[i]);
}

}  // namespace
}  // namespace kdray::test
