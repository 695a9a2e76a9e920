// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/triangle_mesh.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "tests/support/seed.h"

namespace kdray::core {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// A tetrahedron's corners (o, o + sx, o + sy, o + sz) and faces.
MeshData Tetrahedron(Vec3d o, double s) {
  MeshData data;
  data.vertices = {o, o + Vec3d{s, 0, 0}, o + Vec3d{0, s, 0}, o + Vec3d{0, 0, s}};
  data.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  return data;
}

TriangleMesh MustCreate(const MeshData& data) {
  Result<TriangleMesh> mesh = TriangleMesh::Create(data);
  EXPECT_TRUE(mesh.ok()) << (mesh.ok() ? "" : mesh.error().message);
  return *std::move(mesh);
}

// Every used vertex is kept without rounding: its local coordinates lead back to it, and the
// largest one lies in [0.5, 1).
void ExpectExact(const MeshData& data, const TriangleMesh& mesh) {
  double largest = 0;
  for (PrimitiveId id = 0; id < mesh.triangle_count(); ++id) {
    for (int corner = 0; corner < 3; ++corner) {
      const Vec3d local = mesh.LocalCorner(id, corner);
      const Vec3d& world = data.vertices[data.triangles[id][static_cast<std::size_t>(corner)]];
      ASSERT_EQ(mesh.frame().ToWorld(local), world);
      // ToWorld may round; the subtraction and the scaling must not have.
      for (int axis = 0; axis < 3; ++axis) {
        const double difference = world[axis] - mesh.frame().origin[axis];
        ASSERT_EQ(std::ldexp(local[axis], mesh.frame().exponent), difference);
        ASSERT_EQ(static_cast<long double>(difference) + mesh.frame().origin[axis], world[axis]);
      }
      largest = std::max(largest, MaxAbs(local));
    }
  }
  ASSERT_TRUE(largest == 0 || (largest >= 0.5 && largest < 1)) << largest;
}

TEST(TriangleMesh, ScalesByAPowerOfTwoOnly) {
  for (const double size : {1e-300, 1e-30, 1e-3, 1.0, 3.0, 1e30, 3.3e38}) {
    const MeshData data = Tetrahedron({0, 0, 0}, size);
    const TriangleMesh mesh = MustCreate(data);
    EXPECT_EQ(mesh.frame().origin, Vec3d());
    ExpectExact(data, mesh);
    EXPECT_EQ(mesh.bounds(), (Bounds3d{{0, 0, 0}, {size, size, size}}));
  }
}

TEST(TriangleMesh, KeepsDenormalCoordinatesExactly) {
  constexpr double kTiny = std::numeric_limits<double>::denorm_min();
  const MeshData data = Tetrahedron({kTiny, 2 * kTiny, 0}, 5 * kTiny);
  const TriangleMesh mesh = MustCreate(data);
  ExpectExact(data, mesh);
  EXPECT_EQ(mesh.degenerate_count(), 0u);
  EXPECT_FALSE(mesh.has_double_vertices());
}

TEST(TriangleMesh, KeepsFloatDenormalsBesideLargeCoordinatesAsFloats) {
  // After the scaling by 2^-1 the smallest float needs a double.
  MeshData data = Tetrahedron({0, 0, 0}, 1);
  data.vertices[1].y = static_cast<double>(std::numeric_limits<float>::denorm_min());
  EXPECT_TRUE(MustCreate(data).has_double_vertices());
  ExpectExact(data, MustCreate(data));
  data.vertices[1].y *= 2;
  EXPECT_FALSE(MustCreate(data).has_double_vertices());
  ExpectExact(data, MustCreate(data));
}

TEST(TriangleMesh, TakesAnOriginNearAFarMesh) {
  const MeshData data = Tetrahedron({1e7, -3, 1e9}, 1);
  const TriangleMesh mesh = MustCreate(data);
  EXPECT_EQ(mesh.frame().origin, (Vec3d{1e7, 0, 1e9}));
  ExpectExact(data, mesh);
  EXPECT_FALSE(mesh.has_double_vertices());
}

TEST(TriangleMesh, HoldsUtmCoordinatesWithMillimetresExactly) {
  std::mt19937_64 random = test::RandomEngine(10);
  std::uniform_int_distribution<int> millimetre(0, 100000);
  MeshData data;
  for (int i = 0; i < 300; ++i) {
    data.vertices.push_back({500000 + millimetre(random) / 1000.0,
                             4649776 + millimetre(random) / 1000.0, millimetre(random) / 1000.0});
  }
  for (std::uint32_t i = 0; i < 300; i += 3) data.triangles.push_back({i, i + 1, i + 2});
  const TriangleMesh mesh = MustCreate(data);
  EXPECT_NE(mesh.frame().origin.x, 0);
  EXPECT_NE(mesh.frame().origin.y, 0);
  EXPECT_EQ(mesh.frame().origin.z, 0);
  EXPECT_EQ(std::fmod(mesh.frame().origin.x, 64), 0);  // few bits
  ExpectExact(data, mesh);
}

TEST(TriangleMesh, TakesAnOriginBeyondFourExtentsOnly) {
  EXPECT_EQ(MustCreate(Tetrahedron({3.5, 0, 0}, 1)).frame().origin.x, 0);
  EXPECT_EQ(MustCreate(Tetrahedron({3.75, 0, 0}, 1)).frame().origin.x, 4);
  EXPECT_EQ(MustCreate(Tetrahedron({-4.75, 0, 0}, 1)).frame().origin.x, -4);
  MeshData data = Tetrahedron({8, 0, 0}, 1);
  data.vertices.push_back({-1e9, 0, 0});  // unused: does not count
  EXPECT_EQ(MustCreate(data).frame().origin.x, 8);
}

TEST(TriangleMesh, IsExactForRandomMeshesAtAnyScaleAndOffset) {
  std::mt19937_64 random = test::RandomEngine(11);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::uniform_real_distribution<double> exponent(-30, 30);
  for (int round = 0; round < 2000; ++round) {
    const double size = std::pow(10, exponent(random));
    const Vec3d offset{round % 2 == 0 ? 0.0 : std::pow(10, exponent(random)),
                       round % 3 == 0 ? 0.0 : -std::pow(10, exponent(random)),
                       round % 5 == 0 ? 0.0 : std::pow(10, exponent(random))};
    MeshData data;
    for (int i = 0; i < 12; ++i) {
      data.vertices.push_back(Vec3d{unit(random), unit(random), unit(random)} * size + offset);
    }
    data.triangles = {{0, 1, 2}, {3, 4, 5}, {6, 7, 8}, {9, 10, 11}};
    ExpectExact(data, MustCreate(data));
  }
}

TEST(TriangleMesh, ScalesExactlyWithItsInput) {
  const MeshData data = Tetrahedron({1000, 0.1, -7}, 3);
  const TriangleMesh mesh = MustCreate(data);
  for (int k = -100; k <= 100; ++k) {
    MeshData scaled = data;
    for (Vec3d& p : scaled.vertices) p = p * std::ldexp(1.0, k);
    const TriangleMesh copy = MustCreate(scaled);
    EXPECT_EQ(copy.frame().exponent, mesh.frame().exponent + k);
    for (PrimitiveId id = 0; id < 4; ++id) {
      for (int corner = 0; corner < 3; ++corner) {
        EXPECT_EQ(copy.LocalCorner(id, corner), mesh.LocalCorner(id, corner));
      }
    }
  }
}

TEST(TriangleMesh, AcceptsAMeshWhoseCornersAreAllTheOrigin) {
  MeshData data;
  data.vertices = {{0, 0, 0}};
  data.triangles = {{0, 0, 0}};
  const TriangleMesh mesh = MustCreate(data);
  EXPECT_EQ(mesh.frame(), MeshFrame{});
  EXPECT_EQ(mesh.degenerate_count(), 1u);
  data.vertices = {{5, 0, -0.1}};
  EXPECT_EQ(MustCreate(data).LocalCorner(0, 0), Vec3d());
  EXPECT_EQ(MustCreate(data).frame().ToWorld({}), (Vec3d{5, 0, -0.1}));
}

TEST(TriangleMesh, StoresFloatsExactlyWhenThatIsExact) {
  MeshData data = Tetrahedron({0, 0, 0}, static_cast<double>(0.1f));
  EXPECT_FALSE(MustCreate(data).has_double_vertices());
  data = Tetrahedron({0, 0, 0}, 0.1);
  EXPECT_TRUE(MustCreate(data).has_double_vertices());
  EXPECT_EQ(MustCreate(data).bytes(), 4 * 24u + 4 * 12u + 1u);
}

TEST(TriangleMesh, IgnoresWhatUnusedVerticesHold) {
  MeshData data = Tetrahedron({0, 0, 0}, 1);
  data.vertices.push_back({kNan, kInf, -1e300});
  data.vertices.push_back({0.1, 1e9, 1e9});
  const TriangleMesh mesh = MustCreate(data);
  EXPECT_EQ(mesh.vertex_count(), 6u);
  EXPECT_EQ(mesh.bounds(), (Bounds3d{{0, 0, 0}, {1, 1, 1}}));
  EXPECT_FALSE(mesh.has_double_vertices());
  EXPECT_EQ(mesh.vertices<float>()[4], Vec3f());
  EXPECT_EQ(mesh.vertices<float>()[5], Vec3f());
}

TEST(TriangleMesh, RefusesAUsedVertexThatIsNotFiniteOrTooLarge) {
  struct Case {
    double value;
    const char* message;
  };
  for (const Case& c : {Case{kNan, "vertex 3 (counted from 1): y = nan is not finite"},
                        Case{kInf, "vertex 3 (counted from 1): y = inf is not finite"},
                        Case{-1e39, "vertex 3 (counted from 1): y = -1e+39 is beyond 3.4e38"},
                        Case{3.4000001e38,
                             "vertex 3 (counted from 1): y = 3.4000001e+38 is "
                             "beyond 3.4e38"}}) {
    MeshData data = Tetrahedron({0, 0, 0}, 1);
    data.vertices[2].y = c.value;
    const Result<TriangleMesh> mesh = TriangleMesh::Create(data);
    ASSERT_FALSE(mesh.ok());
    EXPECT_EQ(mesh.error().code, ErrorCode::kInvalidMesh);
    EXPECT_EQ(mesh.error().message, c.message);
  }
  const MeshData data = Tetrahedron({-3.4e38, 0, 0}, 3.4e38);
  EXPECT_TRUE(TriangleMesh::Create(data).ok());
}

TEST(TriangleMesh, RefusesAMeshWithoutTriangles) {
  MeshData data = Tetrahedron({0, 0, 0}, 1);
  data.triangles.clear();
  const Result<TriangleMesh> mesh = TriangleMesh::Create(data);
  ASSERT_FALSE(mesh.ok());
  EXPECT_EQ(mesh.error().code, ErrorCode::kEmptyMesh);
}

TEST(TriangleMesh, MarksExactlyCollinearTriangles) {
  MeshData data;
  data.vertices = {{0.1, 0.2, 0.3}, {0.2, 0.4, 0.6}, {0.4, 0.8, 1.2}, {0.4, 0.8, 1.2}, {1, 0, 0}};
  data.vertices[3].z = std::nextafter(1.2, 2.0);
  data.triangles = {{0, 1, 2}, {0, 1, 3}, {0, 0, 4}, {0, 1, 4}, {2, 3, 2}};
  const TriangleMesh mesh = MustCreate(data);
  EXPECT_THAT(mesh.degenerate_flags(), testing::ElementsAre(true, false, true, false, true));
  EXPECT_EQ(mesh.degenerate_count(), 3u);
  EXPECT_TRUE(mesh.IsDegenerate(0));
}

TEST(TriangleMesh, IsTheSameFromItsParts) {
  MeshData data = Tetrahedron({1000, 0, 0}, 0.1);
  data.format = MeshFormat::kOff;
  data.triangles.push_back({0, 0, 1});
  const TriangleMesh mesh = MustCreate(data);
  TriangleMesh::Parts parts;
  parts.format = mesh.format();
  parts.frame = mesh.frame();
  parts.bounds = mesh.bounds();
  parts.vertices.emplace<1>(mesh.vertices<double>().begin(), mesh.vertices<double>().end());
  parts.triangles.assign(mesh.triangles().begin(), mesh.triangles().end());
  parts.degenerate = mesh.degenerate_flags();
  const TriangleMesh copy = TriangleMesh::FromParts(parts).value();
  EXPECT_EQ(copy.format(), MeshFormat::kOff);
  EXPECT_EQ(copy.frame(), mesh.frame());
  EXPECT_EQ(copy.bounds(), mesh.bounds());
  EXPECT_EQ(copy.vertex_count(), 4u);
  EXPECT_EQ(copy.degenerate_count(), 1u);
  EXPECT_EQ(copy.bytes(), mesh.bytes());
  EXPECT_EQ(copy.LocalCorner(3, 2), mesh.LocalCorner(3, 2));
}

TEST(TriangleMesh, SaysWhenItsFrameRoundsACoordinate) {
  MeshData data;
  data.vertices = {{0, 0, 2e-300}, {1, 0, 2e-300}, {0, 1, 2e-300}};
  data.triangles = {{0, 1, 2}};
  EXPECT_FALSE(TriangleMesh::Create(data)->has_rounded_vertices());
  // A vertex that no triangle uses changes nothing.
  for (const Vec3d& p : {Vec3d{1e38, 5, 5}, {1e38, 6, 5}, {1e38, 5, 6}}) data.vertices.push_back(p);
  EXPECT_FALSE(TriangleMesh::Create(data)->has_rounded_vertices());
  data.triangles.push_back({3, 4, 5});
  EXPECT_TRUE(TriangleMesh::Create(data)->has_rounded_vertices());
  // What is left is kept exactly where it is a multiple of 2^-1074 of the frame.
  for (std::size_t i = 0; i < 3; ++i) data.vertices[i].z = std::ldexp(3, 127 - 1074);
  EXPECT_FALSE(TriangleMesh::Create(data)->has_rounded_vertices());
  for (std::size_t i = 0; i < 3; ++i) data.vertices[i].z = std::ldexp(3, 126 - 1074);
  EXPECT_TRUE(TriangleMesh::Create(data)->has_rounded_vertices());
}

TEST(MeshFrame, MovesPointsThatAreNoVerticesWithinRounding) {
  const MeshFrame frame{{1000, 0, -4}, 3};
  EXPECT_EQ(frame.ToLocal({1008, 4, -4}), (Vec3d{1, 0.5, 0}));
  EXPECT_EQ(frame.ToWorld({1, 0.5, 0}), (Vec3d{1008, 4, -4}));
}

}  // namespace
}  // namespace kdray::core
