#include "core/trace/exact_test.h"

#include <gmpxx.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <random>

#include "core/geometry/local_ray.h"
#include "core/trace/double_double.h"
#include "core/trace/dyadic.h"
#include "tests/support/rationals.h"

namespace kdray::core {
namespace {

using test::IsInInterval;
using test::IsWithinOneUlp;
using test::RationalHit;
using test::TriangleCorners;

TriangleCorners Local(const TriangleCorners& triangle, const MeshFrame& frame) {
  return {frame.ToLocal(triangle[0]), frame.ToLocal(triangle[1]), frame.ToLocal(triangle[2])};
}

std::mt19937_64& Engine() {
  static std::mt19937_64 engine{1997};
  return engine;
}
int Int(int low, int high) { return std::uniform_int_distribution<int>(low, high)(Engine()); }
double Real(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(Engine());
}

struct Tally {
  int cases = 0, hits = 0;
};

/// Holds one ray and two triangles against the oracle.
void Check(const Ray& ray, const std::array<TriangleCorners, 2>& triangles, const MeshFrame& frame,
           Tally* tally) {
  const auto local_ray = MakeLocalRay(ray, frame);
  ASSERT_TRUE(local_ray.has_value());
  const ExactTest test(*local_ray);
  std::array<std::optional<mpq_class>, 2> expected;
  std::array<ExactTest::Hit, 2> hits;
  const auto corners_of = [&](PrimitiveId id) { return Local(triangles[id], frame); };
  for (PrimitiveId id = 0; id < 2; ++id) {
    expected[id] = RationalHit(ray, triangles[id]);
    const auto [a, b, c] = corners_of(id);
    const bool hit = test.Test(a, b, c, &hits[id]);
    ASSERT_EQ(hit, expected[id].has_value()) << "case " << tally->cases;
    ++tally->cases;
    if (!hit) continue;
    ++tally->hits;
    ASSERT_TRUE(IsWithinOneUlp(test.CallerT(hits[id]), *expected[id]));
    ASSERT_GE(hits[id].u, 0);
    ASSERT_GE(hits[id].v, 0);
    ASSERT_LE(hits[id].u + hits[id].v, 1 + 1e-12);
    ASSERT_EQ(test.IsInInterval(hits[id], id, corners_of), IsInInterval(ray, *expected[id]));
  }
  if (!expected[0] || !expected[1]) return;
  const int order = cmp(*expected[0], *expected[1]);
  ASSERT_EQ(test.IsCloser(hits[0], 0, hits[1], 1, corners_of), order <= 0);
  ASSERT_EQ(test.IsCloser(hits[1], 1, hits[0], 0, corners_of), order < 0 ? false : order > 0);
}

TEST(ExactTest, AgreesWithRationalsOnSmallIntegersWhereMostCasesAreDegenerate) {
  const MeshFrame frame{{0, 0, 0}, 3};
  Tally tally;
  for (int i = 0; i < 20'000 && !testing::Test::HasFatalFailure(); ++i) {
    const auto point = [] {
      return Vec3d{double(Int(-3, 3)), double(Int(-3, 3)), double(Int(-3, 3))};
    };
    const std::array<TriangleCorners, 2> triangles{TriangleCorners{point(), point(), point()},
                                                   {point(), point(), point()}};
    Ray ray;
    ray.origin = point();
    ray.direction = point() - ray.origin;
    if (!IsValid(ray)) continue;
    if (Int(0, 1)) ray.t_max = Int(0, 4) * 0.5;
    if (Int(0, 1)) ray.t_min = Int(-4, 0) * 0.5;
    if (!IsValid(ray)) continue;
    Check(ray, triangles, frame, &tally);
  }
  EXPECT_GT(tally.hits, 2'000);
}

TEST(ExactTest, AgreesWithRationalsWhenAimedAtCornersAndEdgesOfRealTriangles) {
  for (const MeshFrame& frame : {MeshFrame{}, MeshFrame{{448'000, 5'411'000, 0}, 10},
                                 MeshFrame{{0, 0, 0}, -100}, MeshFrame{{0, 0, 0}, 110}}) {
    Tally tally;
    const double size = std::ldexp(1, frame.exponent);
    const auto vertex = [&] {
      // Multiples of 2^-40 of the frame: exact in it, and far from it in double for the moved
      // frame.
      const auto coordinate = [&](double o) {
        return o + std::ldexp(std::round(std::ldexp(Real(-0.99, 0.99), 26)), frame.exponent - 26);
      };
      return Vec3d{coordinate(frame.origin.x), coordinate(frame.origin.y),
                   coordinate(frame.origin.z)};
    };
    for (int i = 0; i < 2'000 && !testing::Test::HasFatalFailure(); ++i) {
      const Vec3d a = vertex(), b = vertex();
      const std::array<TriangleCorners, 2> triangles{TriangleCorners{a, b, vertex()},
                                                     {b, a, vertex()}};  // they share an edge
      const double w = Int(0, 2) * 0.5;
      const Vec3d target = a * w + b * (1 - w);
      Ray ray;
      ray.origin = target + Vec3d{Real(-2, 2), Real(-2, 2), Real(-2, 2)} * size;
      ray.direction = target - ray.origin;
      ray.t_max = Int(0, 1) ? 1.0 : 0.75;
      Check(ray, triangles, frame, &tally);
    }
    EXPECT_GT(tally.hits, 500);
  }
}

TEST(ExactTest, AgreesWithRationalsForOriginsFarAway) {
  Tally tally;
  const MeshFrame frame{};
  for (int i = 0; i < 2'000 && !testing::Test::HasFatalFailure(); ++i) {
    const auto point = [] { return Vec3d{Real(-0.9, 0.9), Real(-0.9, 0.9), Real(-0.9, 0.9)}; };
    const std::array<TriangleCorners, 2> triangles{TriangleCorners{point(), point(), point()},
                                                   {point(), point(), point()}};
    const double distance = std::exp2(Real(3, 30));
    Ray ray;
    ray.direction = Vec3d{Real(-1, 1), Real(-1, 1), Real(-1, 1)};
    ray.origin = triangles[0][static_cast<std::size_t>(Int(0, 2))] - ray.direction * distance;
    if (!MakeLocalRay(ray, frame)) continue;
    Check(ray, triangles, frame, &tally);
  }
  EXPECT_GT(tally.hits, 200);
}

// So far away that the mesh is smaller than the rounding of the way to it: only the numbers as
// given tell whether the ray, which goes through the origin or a power of two beside it, hits.
TEST(ExactTest, AgreesWithRationalsForOriginsFartherThanTheDigitsOfDouble) {
  Tally tally;
  const MeshFrame frame{};
  for (int i = 0; i < 3'000 && !testing::Test::HasFatalFailure(); ++i) {
    const auto point = [] { return Vec3d{Int(-7, 7) / 8.0, Int(-7, 7) / 8.0, Int(-7, 7) / 8.0}; };
    const std::array<TriangleCorners, 2> triangles{TriangleCorners{point(), point(), point()},
                                                   {point(), point(), point()}};
    Ray ray;
    ray.direction = Vec3d{double(Int(-999, 999)), double(Int(-999, 999)), double(Int(-999, 999))};
    ray.origin = -ray.direction * std::ldexp(1, Int(40, 300));
    if (Int(0, 1)) {
      // An axis along which it does not run may hold the small number that counts.
      const int axis = Int(0, 2);
      ray.direction[axis] = 0;
      ray.origin[axis] = Int(-7, 7) / 8.0;
    }
    if (!IsValid(ray)) continue;
    if (!MakeLocalRay(ray, frame)) {
      for (const TriangleCorners& triangle : triangles)
        ASSERT_FALSE(RationalHit(ray, triangle)) << "case " << i;
      continue;
    }
    Check(ray, triangles, frame, &tally);
  }
  EXPECT_GT(tally.hits, 500);
}

TEST(DoubleDouble, OperationsKeepTheirErrorBounds) {
  for (int i = 0; i < 5'000; ++i) {
    const auto number = [] {
      return FastTwoSum(std::ldexp(Real(-1, 1), Int(-60, 60)), 0) +
             DoubleDouble{std::ldexp(Real(-1, 1), Int(-120, 0)), 0};
    };
    const DoubleDouble a = number(), b = number();
    const auto exact = [](const DoubleDouble& x) -> mpq_class {
      return mpq_class(x.high) + mpq_class(x.low);
    };
    const mpq_class tolerance = mpq_class(0x1p-102);
    const auto expect_near = [&](const DoubleDouble& got, const mpq_class& want) {
      ASSERT_LE(abs(exact(got) - want), tolerance * abs(want));
    };
    expect_near(a + b, exact(a) + exact(b));
    expect_near(a * b, exact(a) * exact(b));
    if (b.high != 0) expect_near(a / b, exact(a) / exact(b));
  }
}

TEST(Dyadic, QuotientsAreRoundedToNearest) {
  for (int i = 0; i < 5'000; ++i) {
    const double n = std::ldexp(Real(-1, 1), Int(-300, 300)),
                 d = std::ldexp(Real(0.5, 1), Int(-300, 300));
    ASSERT_EQ(Dyadic::Quotient(Dyadic(n), Dyadic(d)), n / d);
  }
  EXPECT_EQ(Dyadic::Quotient(Dyadic(0.0), Dyadic(3.0)), 0);
  EXPECT_EQ(Dyadic::Quotient(Dyadic(1.0), Dyadic(-3.0)), -1.0 / 3);
}

TEST(Dyadic, SumsAndProductsNeitherRoundNorUnderflow) {
  const Dyadic tiny(0x1p-1074), huge(0x1p1023);
  EXPECT_EQ((tiny * tiny).Sign(), 1);
  EXPECT_EQ((huge + tiny - huge - tiny).Sign(), 0);
  EXPECT_EQ((huge + tiny - huge).Sign(), 1);
  EXPECT_EQ((Dyadic(-1.0) * tiny * tiny * tiny).Sign(), -1);
}

}  // namespace
}  // namespace kdray::core
