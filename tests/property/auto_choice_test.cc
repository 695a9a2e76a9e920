// SPDX-License-Identifier: Apache-2.0
// The build that `auto` chooses against the expected costs of both builds, over the collection and
// generated meshes. Times are measured in tests/bench/auto.
#include "core/accel/auto_choice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/accel/expected_cost.h"
#include "core/accel/tree.h"
#include "core/base/parallel.h"
#include "core/io/mesh_reader.h"
#include "tests/support/mesh_files.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using core::AutoChoice;
using core::BuildKind;
using core::TriangleMesh;

struct Costs {
  AutoChoice choice;
  double bvh = 0, kd_sah = 0;  // with the time of rays at equal cost

  double chosen() const { return choice.build() == BuildKind::kBvh ? bvh : kd_sah; }
  /// Of the chosen build to the cheaper one.
  double excess() const { return chosen() / std::min(bvh, kd_sah); }
};

// As core/library/scene_loader.h chooses; and the tree that it may not have built.
Costs CostsOf(const TriangleMesh& mesh) {
  Costs costs;
  core::Arena(2).Run([&] {
    const auto cost = [&](BuildKind build) {
      return core::ExpectedCost(core::BuildTree(mesh, build).value()).value();
    };
    costs.choice.overlap = core::BoxOverlap(mesh).value();
    costs.bvh = cost(BuildKind::kBvh);
    costs.kd_sah = cost(BuildKind::kKdSah);
  });
  if (!costs.choice.OverlapsLittle()) costs.choice.costs = {costs.bvh, costs.kd_sah};
  costs.kd_sah *= AutoChoice::kKdSahFactor;
  return costs;
}

struct NamedCosts {
  std::string name;
  std::size_t triangles = 0;
  Costs costs;
};

void ExpectGoodChoices(const std::vector<NamedCosts>& meshes) {
  double excess = 0, to_kd_sah = 0;
  std::size_t cheaper = 0;
  for (const auto& [name, triangles, costs] : meshes) {
    EXPECT_LE(costs.excess(), 1.05)
        << name << ", " << triangles << " triangles, overlap " << costs.choice.overlap << ": bvh "
        << costs.bvh << ", kd-sah " << costs.kd_sah;
    excess += std::log(costs.excess());
    to_kd_sah += std::log(costs.kd_sah / costs.chosen());
    cheaper += costs.excess() == 1 ? 1 : 0;
  }
  const auto count = static_cast<double>(meshes.size());
  EXPECT_LE(std::exp(excess / count), 1.01) << "all choices together";
  EXPECT_GE(std::exp(to_kd_sah / count), 1) << "better than kd-sah always";
  EXPECT_GE(static_cast<double>(cheaper), 0.8 * count);
}

TEST(AutoChoice, CostsLittleMoreThanTheCheaperBuildOnTheCollection) {
  KDRAY_NEED_MESHES();
  constexpr std::size_t kMostBytes = std::size_t{8} << 20;
  std::vector<NamedCosts> meshes;
  for (const auto& file : std::filesystem::directory_iterator(*MeshFolder())) {
    if (!file.is_regular_file() || file.file_size() > kMostBytes) continue;
    // Also lists, notes, and meshes that are no meshes.
    const auto data = core::ReadMesh(ReadFileBytes(file.path()));
    if (!data.ok()) continue;
    const auto mesh = TriangleMesh::Create(*data);
    if (!mesh.ok() || core::NeedsNoTree(mesh->triangle_count())) continue;
    meshes.push_back({file.path().filename().string(), mesh->triangle_count(), CostsOf(*mesh)});
  }
  ExpectGoodChoices(meshes);
}

TEST(AutoChoice, CostsLittleMoreThanTheCheaperBuildOnGeneratedMeshes) {
  const std::pair<const char*, core::MeshData> shapes[] = {
      {"sphere", UvSphere({0, 0, 0}, 1, 60, 120)},
      {"bumpy sphere", BumpySphere({0, 0, 0}, 1, 100, 200, 0.3)},
      {"icosphere", IcoSphere({0, 0, 0}, 1, 5)},
      {"grid", Grid(64, 1, 0.5)},
      {"fine soup", Soup(20'000, 0.01, 1)},
      {"soup", Soup(5'000, 0.1, 2)},
      {"coarse soup", Soup(1'000, 0.5, 3)},
      {"straddling", Straddling(400, 4)},
      {"comb", Comb(1'000)},
      {"spiral", Spiral(5'000, 20)},
      {"staircase", Staircase(2'000)},
      {"nest", Nest(20)},
      {"coincident", Coincident(200)},
  };
  std::vector<NamedCosts> meshes;
  for (const auto& [name, data] : shapes) {
    const TriangleMesh mesh = TriangleMesh::Create(data).value();
    meshes.push_back({name, mesh.triangle_count(), CostsOf(mesh)});
  }
  ExpectGoodChoices(meshes);
}

}  // namespace
}  // namespace kdray::test
