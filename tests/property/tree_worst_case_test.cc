// SPDX-License-Identifier: Apache-2.0
// N17: meshes that are hard to build a tree over cost no more than a small factor of a tame mesh of
// their size, in time and in memory. Both are measured in one run, so a slow machine is slow for
// both.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <string>

#include "core/accel/tree.h"
#include "core/base/parallel.h"
#include "tests/support/allocation_count.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::MeshData;
using core::TriangleMesh;

constexpr double kFactor = 3.5;

struct Expense {
  double seconds = 0;
  std::uint64_t bytes = 0;
};

Expense Build(const MeshData& data, BuildKind kind, core::Arena& arena) {
  const TriangleMesh mesh = TriangleMesh::Create(data).value();
  Expense expense;
  const AllocationPeak peak;
  const auto start = std::chrono::steady_clock::now();
  std::uint64_t promised = 0;
  arena.Run([&] {
    const auto binary = core::BuildBinaryTree(mesh, kind);
    ASSERT_TRUE(binary.ok());
    promised = core::EstimateFinishBytes(*binary);
    ASSERT_TRUE(core::FinishTree(mesh, kind, *binary).ok());
  });
  expense.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  expense.bytes = peak.bytes();
  EXPECT_LE(expense.bytes,
            std::max(promised, core::EstimateBuildBytes(mesh.triangle_count(), kind)));
  return expense;
}

struct HardMesh {
  const char* name;
  MeshData data;
  double size;  // in tame meshes
};

class HardMeshes : public testing::TestWithParam<BuildKind> {};

TEST_P(HardMeshes, CostLittleMoreThanATameMeshOfTheirSize) {
  const BuildKind kind = GetParam();
  constexpr std::size_t kTriangles = 100'000;
  core::Arena arena(2);
  const MeshData tame = BumpySphere({0, 0, 0}, 1, 250, 200, 0.3);
  Build(tame, kind, arena);  // warms up the allocator
  Expense limit = Build(tame, kind, arena);
  // Shorter times say more about the machine than about the build.
  limit.seconds = std::max(limit.seconds, 0.02);

  const HardMesh hard[] = {
      // Ten times as many: builds are at least linear, so the limit may grow as much.
      {"a million coincident", Coincident(10 * kTriangles), 10},
      {"all straddling", Straddling(kTriangles, 21), 1},
      {"large triangles", Soup(kTriangles, 0.5, 22), 1},
      {"scattered", Soup(kTriangles, 0.01, 23), 1},
      {"comb", Comb(kTriangles / 4), 1},
      {"spiral", Spiral(kTriangles, 100), 1},
      {"nest", Nest(100), 1},
  };
  for (const HardMesh& mesh : hard) {
    const Expense expense = Build(mesh.data, kind, arena);
    EXPECT_LE(expense.seconds, kFactor * mesh.size * limit.seconds) << mesh.name;
    EXPECT_LE(expense.bytes, kFactor * mesh.size * static_cast<double>(limit.bytes)) << mesh.name;
  }
}

INSTANTIATE_TEST_SUITE_P(EveryBuild, HardMeshes, testing::ValuesIn(core::kAllBuildKinds),
                         [](const auto& param) {
                           std::string name(Name(param.param));
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

}  // namespace
}  // namespace kdray::test
