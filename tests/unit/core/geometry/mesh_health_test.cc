// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/mesh_health.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "core/io/mesh_reader.h"
#include "tests/support/csv.h"
#include "tests/support/gltf_mesh.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

MeshHealth Check(const MeshData& data) {
  const Result<TriangleMesh> mesh = TriangleMesh::Create(data);
  EXPECT_TRUE(mesh.ok());
  return *CheckHealth(*mesh, data);
}

MeshData Tetrahedron() {
  MeshData data;
  data.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  data.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  return data;
}

// The same mesh with three vertices of its own for each triangle, as in an STL.
MeshData Apart(const MeshData& data) {
  MeshData apart = data;
  apart.vertices.clear();
  for (TriangleIndices& triangle : apart.triangles) {
    for (std::uint32_t& index : triangle) {
      apart.vertices.push_back(data.vertices[index]);
      index = static_cast<std::uint32_t>(apart.vertices.size() - 1);
    }
  }
  return apart;
}

TEST(MeshHealth, FindsATetrahedronClosed) {
  for (const MeshData& data : {Tetrahedron(), Apart(Tetrahedron())}) {
    const MeshHealth health = Check(data);
    EXPECT_TRUE(health.closed);
    EXPECT_EQ(health.open_edges, 0u);
    EXPECT_EQ(health.non_manifold_edges, 0u);
    EXPECT_EQ(health.duplicate, 0u);
    EXPECT_EQ(health.degenerate, 0u);
  }
}

TEST(MeshHealth, FindsATetrahedronClosedInsideOutToo) {
  MeshData data = Tetrahedron();
  for (TriangleIndices& triangle : data.triangles) std::swap(triangle[0], triangle[1]);
  EXPECT_TRUE(Check(data).closed);
}

TEST(MeshHealth, FindsTheOpenEdgesOfAMissingTriangle) {
  MeshData data = Tetrahedron();
  data.triangles.pop_back();
  const MeshHealth health = Check(data);
  EXPECT_FALSE(health.closed);
  EXPECT_EQ(health.open_edges, 3u);
  EXPECT_EQ(health.non_manifold_edges, 0u);
}

TEST(MeshHealth, DoesNotCallOneTurnedTriangleClosed) {
  MeshData data = Tetrahedron();
  std::swap(data.triangles[2][0], data.triangles[2][1]);
  const MeshHealth health = Check(data);
  EXPECT_FALSE(health.closed);
  EXPECT_EQ(health.open_edges, 0u);
  EXPECT_EQ(health.non_manifold_edges, 0u);
}

TEST(MeshHealth, CountsTheEdgesOfADuplicateAsNonManifold) {
  MeshData data = Tetrahedron();
  data.triangles.push_back({3, 1, 2});
  data.triangles.push_back({2, 1, 3});
  const MeshHealth health = Check(data);
  EXPECT_EQ(health.duplicate, 2u);
  EXPECT_EQ(health.non_manifold_edges, 3u);
  EXPECT_FALSE(health.closed);
  EXPECT_EQ(Check(Apart(data)), health);
}

TEST(MeshHealth, JoinsMinusZeroAndZeroAndNothingElse) {
  MeshData data = Apart(Tetrahedron());
  for (std::size_t i = 0; i < data.vertices.size(); i += 2) {
    for (int axis = 0; axis < 3; ++axis) {
      if (data.vertices[i][axis] == 0) data.vertices[i][axis] = -0.0;
    }
  }
  EXPECT_TRUE(Check(data).closed);
  data.vertices[1].x += std::numeric_limits<double>::denorm_min();
  EXPECT_FALSE(Check(data).closed);
}

TEST(MeshHealth, LeavesZeroAreaTrianglesOutOfEverythingButTheirCount) {
  MeshData data = Tetrahedron();
  data.triangles.push_back({0, 0, 1});
  data.triangles.push_back({1, 0, 0});
  data.triangles.push_back({2, 2, 2});
  MeshHealth health = Check(data);
  EXPECT_EQ(health.degenerate, 3u);
  EXPECT_EQ(health.duplicate, 0u);
  EXPECT_TRUE(health.closed);
  // A T-junction that only a triangle without area fills is open.
  data = Tetrahedron();
  data.vertices.push_back({0.5, 0, 0});
  data.triangles[1] = {0, 4, 3};
  data.triangles.push_back({4, 1, 3});
  data.triangles.push_back({0, 1, 4});
  health = Check(data);
  EXPECT_EQ(health.degenerate, 1u);
  EXPECT_EQ(health.open_edges, 3u);
  EXPECT_FALSE(health.closed);
}

TEST(MeshHealth, CallsAMeshOfZeroAreaTrianglesNotClosed) {
  MeshData data = Tetrahedron();
  data.triangles = {{0, 0, 1}};
  EXPECT_FALSE(Check(data).closed);
}

TEST(MeshHealth, GivesTheSpacingOfTheFilesNumbersAtTheLargestCoordinate) {
  MeshData data = Tetrahedron();
  data.vertices[1].x = -1e6;
  EXPECT_EQ(Check(data).coordinate_resolution, 0x1p-33);
  data.single_precision = true;
  EXPECT_EQ(Check(data).coordinate_resolution, 0x1p-4);
}

TEST(MeshHealth, PassesOnHowManyPolygonsWereConcave) {
  MeshData data = Tetrahedron();
  data.concave = 7;
  EXPECT_EQ(Check(data).concave, 7u);
}

TEST(MeshHealth, IsQuickWhenAllPositionsAreTheSameOrAllEdgesMeet) {
  MeshData data;
  data.vertices.push_back({0, 0, 1});
  for (std::uint32_t i = 1; i <= 200000; ++i) {
    data.vertices.push_back({std::cos(0.1 * i), std::sin(0.1 * i), 0});
    data.vertices.push_back({0, 0, 1});
    if (i > 1) data.triangles.push_back({0, 2 * i - 3, 2 * i - 1});
  }
  const MeshHealth health = Check(data);
  EXPECT_FALSE(health.closed);
  EXPECT_EQ(health.non_manifold_edges, 0u);
}

// The oracle: the same counts by hash maps, with the two rules that the collection's own counts
// follow otherwise as switches.
struct Rules {
  bool join_in_float = false;   // join positions that are equal as floats
  bool keep_collinear = false;  // leave out only triangles with a repeated corner
};

struct Counts {
  std::uint64_t duplicate = 0;
  std::uint64_t open_edges = 0;
  std::uint64_t non_manifold_edges = 0;
  bool closed = false;
};

struct HashBytes {
  template <class T>
  std::size_t operator()(const T& value) const {
    return std::hash<std::string_view>()(
        std::string_view(reinterpret_cast<const char*>(&value), sizeof value));
  }
};

Counts CountPlainly(const TriangleMesh& mesh, const MeshData& data, Rules rules) {
  std::unordered_map<std::array<double, 3>, std::uint32_t, HashBytes> numbers;
  const auto number = [&](std::uint32_t index) {
    const Vec3d& p = data.vertices[index];
    const Vec3d q = (rules.join_in_float ? Vec3d(Vec3f(p)) : p) + Vec3d{};
    return numbers.emplace(std::array{q.x, q.y, q.z}, static_cast<std::uint32_t>(numbers.size()))
        .first->second;
  };
  struct Sides {
    int forward = 0;
    int backward = 0;
  };
  std::unordered_map<std::array<std::uint32_t, 2>, Sides, HashBytes> edges;
  std::unordered_set<TriangleIndices, HashBytes> seen;
  edges.reserve(2 * data.triangles.size());
  seen.reserve(data.triangles.size());
  Counts counts;
  for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
    const auto [i, j, k] = data.triangles[id];
    TriangleIndices corners = {number(i), number(j), number(k)};
    const bool repeats =
        corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0];
    if (rules.keep_collinear ? repeats : mesh.IsDegenerate(id)) continue;
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const std::uint32_t from = corners[corner];
      const std::uint32_t to = corners[(corner + 1) % 3];
      Sides& sides = edges[{std::min(from, to), std::max(from, to)}];
      ++(from < to ? sides.forward : sides.backward);
    }
    std::sort(corners.begin(), corners.end());
    if (!seen.insert(corners).second) ++counts.duplicate;
  }
  counts.closed = !edges.empty();
  for (const auto& [edge, sides] : edges) {
    const int triangles = sides.forward + sides.backward;
    if (triangles == 1) ++counts.open_edges;
    if (triangles > 2) ++counts.non_manifold_edges;
    counts.closed = counts.closed && sides.forward == 1 && sides.backward == 1;
  }
  return counts;
}

void ExpectPlainCounts(const MeshData& data) {
  const Result<TriangleMesh> mesh = TriangleMesh::Create(data);
  ASSERT_TRUE(mesh.ok());
  const MeshHealth health = *CheckHealth(*mesh, data);
  const Counts counts = CountPlainly(*mesh, data, {});
  EXPECT_EQ(health.duplicate, counts.duplicate);
  EXPECT_EQ(health.open_edges, counts.open_edges);
  EXPECT_EQ(health.non_manifold_edges, counts.non_manifold_edges);
  EXPECT_EQ(health.closed, counts.closed);
}

TEST(MeshHealth, CountsAsHashMapsDoOnRandomMeshes) {
  std::mt19937_64 random = test::RandomEngine(40);
  for (int round = 0; round < 3000; ++round) {
    std::uniform_int_distribution<int> grid(0, 1 + round % 2);
    std::uniform_int_distribution<std::uint32_t> pick(0, 9);
    MeshData data;
    for (int i = 0; i < 10; ++i) {
      data.vertices.push_back({static_cast<double>(grid(random)), static_cast<double>(grid(random)),
                               static_cast<double>(grid(random))});
    }
    for (int i = 0; i < 1 + round % 20; ++i) {
      data.triangles.push_back({pick(random), pick(random), pick(random)});
    }
    ExpectPlainCounts(data);
    if (HasFailure()) return;
  }
}

TEST(MeshHealth, AgreesWithTheCollection) {
  KDRAY_NEED_MESHES();
  int read = 0;
  for (const test::CsvRow& row : test::ReadCsv(*test::MeshFolder() / "MANIFEST.csv")) {
    const std::string& file = row.at("file");
    SCOPED_TRACE(file);
    if (file == "mode5_strips.gltf") continue;  // the tests' reader has no strips
    const std::vector<std::byte> bytes = test::ReadFileBytes(*test::MeshFolder() / file);
    const bool is_gltf = row.at("format") == "glb" || row.at("format") == "gltf";
    const Result<MeshData> data = is_gltf ? test::ReadGltf(bytes) : ReadMesh(bytes);
    ASSERT_TRUE(data.ok());
    if (data->triangles.size() < 50000) ExpectPlainCounts(*data);
    const Result<TriangleMesh> mesh = TriangleMesh::Create(*data);
    // The collection's counts are of polygons cut into fans, whatever their shape.
    if (data->concave > 0 && (file == "office_chair.obj" || file == "concave_66gon.obj" ||
                              file == "wallhole_crlf.obj")) {
      continue;
    }
    ++read;
    EXPECT_EQ(std::to_string(mesh->degenerate_count()), row.at("degenerate_faces"));
    const Counts counts =
        CountPlainly(*mesh, *data, {.join_in_float = true, .keep_collinear = true});
    EXPECT_EQ(std::to_string(counts.duplicate), row.at("duplicate_faces"));
    EXPECT_EQ(std::to_string(counts.open_edges), row.at("boundary_edges"));
    EXPECT_EQ(std::to_string(counts.non_manifold_edges), row.at("nonmanifold_edges"));
    EXPECT_EQ(counts.closed, row.at("watertight").starts_with("yes"));
    // And by our own rules, for every mesh that the collection calls clean.
    if (row.at("clean_solid") == "1") {
      EXPECT_TRUE(CheckHealth(*mesh, *data)->closed);
    }
  }
  EXPECT_GT(read, 80);
}

}  // namespace
}  // namespace kdray::core
