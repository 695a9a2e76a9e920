// Every build on every kind of mesh: the structure holds what its traversal relies on.
#include "core/scene/tree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/scene/scene.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"
#include "tests/unit/core/tree_checks.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::MeshData;
using core::Tree;
using core::TriangleMesh;

struct NamedMesh {
  const char* name;
  MeshData data;
};

// Each kind of trouble once, small enough for a check that is quadratic in places.
std::vector<NamedMesh> Zoo() {
  std::vector<NamedMesh> zoo;
  zoo.push_back({"sphere", UvSphere({3, 2, 1}, 2, 24, 48)});
  zoo.push_back({"float sphere", RoundToFloat(IcoSphere({0.1, 0.2, 0.3}, 1, 3))});
  zoo.push_back({"bumpy sphere", BumpySphere({0, 0, 0}, 1, 30, 40, 0.3)});
  zoo.push_back({"cube", Cube({0, 0, 0}, 1)});
  for (int axis = 0; axis < 3; ++axis) zoo.push_back({"grid", Grid(16, axis, 0.3)});
  zoo.push_back({"two grids", Join(Grid(9, 0, 0.5), Grid(9, 2, 0.5))});
  zoo.push_back({"fine soup", Soup(3000, 0.02, 1)});
  zoo.push_back({"coarse soup", Soup(300, 0.7, 2)});
  zoo.push_back({"coincident", Coincident(500)});
  zoo.push_back({"straddling", Straddling(400, 3)});
  zoo.push_back({"comb", Comb(300)});
  zoo.push_back({"spiral", Spiral(2000, 20)});
  zoo.push_back({"staircase", Staircase(256)});
  zoo.push_back({"nest", Nest(99)});
  zoo.push_back({"large", Soup(40000, 0.01, 4)});
  MeshData degenerate = Soup(100, 0.3, 5);
  for (std::size_t i = 0; i < 100; i += 3) degenerate.triangles[i][2] = degenerate.triangles[i][0];
  zoo.push_back({"partly degenerate", degenerate});
  MeshData single;
  single.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  single.triangles = {{0, 1, 2}};
  zoo.push_back({"one triangle", single});
  single.triangles = {{0, 1, 1}};
  zoo.push_back({"nothing but degenerate", single});
  return zoo;
}

TEST(BuildTree, HoldsWhatTraversalReliesOnForEveryBuildAndMesh) {
  for (const NamedMesh& item : Zoo()) {
    const TriangleMesh mesh = TriangleMesh::Create(item.data).value();
    for (const BuildKind kind : core::kAllBuildKinds) {
      SCOPED_TRACE(std::string(item.name) + ", " + std::string(Name(kind)));
      auto tree = core::BuildTree(mesh, kind);
      ASSERT_TRUE(tree.ok());
      EXPECT_EQ(tree->build, kind);
      std::visit(
          [&](const auto& structure) {
            EXPECT_TRUE(structure.Validate(mesh.triangle_count()).ok());
            CheckReachability(structure, mesh);
          },
          tree->structure);
    }
  }
}

}  // namespace
}  // namespace kdray::test
