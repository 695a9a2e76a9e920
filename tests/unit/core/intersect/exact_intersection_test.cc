// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/exact_intersection.h"

#include <gmpxx.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <random>

#include "core/geometry/double_double.h"
#include "core/geometry/dyadic.h"
#include "core/geometry/local_ray.h"
#include "tests/support/allocation_count.h"
#include "tests/support/rationals.h"

namespace kdray::core {
namespace {

using test::IsInInterval;
using test::RationalHit;
using test::RoundedToNearest;
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
  const auto local_ray = ExactIntersection::MakeRay(ray, frame);
  if (!local_ray) {
    for (const TriangleCorners& triangle : triangles) {
      ASSERT_FALSE(RationalHit(ray, triangle)) << "case " << tally->cases;
    }
    return;
  }
  const ExactIntersection test(*local_ray);
  std::array<std::optional<mpq_class>, 2> expected;
  std::array<ExactIntersection::Hit, 2> hits;
  const auto corners_of = [&](PrimitiveId id) { return Local(triangles[id], frame); };
  for (PrimitiveId id = 0; id < 2; ++id) {
    expected[id] = RationalHit(ray, triangles[id]);
    const auto [a, b, c] = corners_of(id);
    const bool hit = test.Test(a, b, c, &hits[id]);
    ASSERT_EQ(hit, expected[id].has_value()) << "case " << tally->cases;
    ++tally->cases;
    if (!hit) continue;
    ++tally->hits;
    const core::Hit answer = test.Finish(hits[id], id, corners_of);
    ASSERT_EQ(answer.t, RoundedToNearest(*expected[id])) << "case " << tally->cases;
    ASSERT_FALSE(answer.t == 0 && std::signbit(answer.t));
    const test::RationalWeights weights = test::WeightsOf(ray, triangles[id]);
    for (const auto& [got, want] : {std::pair{answer.u, weights.u}, {answer.v, weights.v}}) {
      ASSERT_TRUE(got >= 0 && got <= 1 && !std::signbit(got)) << "case " << tally->cases;
      ASSERT_LE(abs(mpq_class(got) - want), mpq_class(0x1p-53)) << "case " << tally->cases;
    }
    ASSERT_EQ(test.IsInInterval(hits[id], id, corners_of), IsInInterval(ray, *expected[id]))
        << "case " << tally->cases << ", t " << answer.t << " in " << ray.t_min << ", "
        << ray.t_max;
  }
  if (!expected[0] || !expected[1]) return;
  const int order = cmp(*expected[0], *expected[1]);
  ASSERT_EQ(test.IsCloser(hits[0], 0, hits[1], 1, corners_of), order <= 0);
  ASSERT_EQ(test.IsCloser(hits[1], 1, hits[0], 0, corners_of), order < 0 ? false : order > 0);
}

TEST(ExactIntersection, AgreesWithRationalsOnSmallIntegersWhereMostCasesAreDegenerate) {
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

TEST(ExactIntersection, AgreesWithRationalsWhenAimedAtCornersAndEdgesOfRealTriangles) {
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

TEST(ExactIntersection, AgreesWithRationalsForOriginsFarAway) {
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
    Check(ray, triangles, frame, &tally);
  }
  EXPECT_GT(tally.hits, 200);
}

/// A point in the frame, times the frame's scale: a multiple of `unit`, up to `size` from `middle`.
Vec3d Multiple(const Vec3d& middle, double size, double unit) {
  const auto coordinate = [&](double m) { return m + std::round(Real(-size, size) / unit) * unit; };
  return {coordinate(middle.x), coordinate(middle.y), coordinate(middle.z)};
}

Vec3d Between(const Vec3d& a, const Vec3d& b, double weight_of_a) {
  return a * weight_of_a + b * (1 - weight_of_a);
}

// Triangles from the mesh's size down to 2^-400 of it, meshes from 2^-600 to 2^120, origins from on
// the triangle to 2^1000 mesh sizes away, directions from 2^-1000 to 2^1000: t over- and
// underflows, and everything but the numbers as given is lost in rounding.
TEST(ExactIntersection, AgreesWithRationalsAtAnyScaleOfMeshTriangleDistanceAndDirection) {
  Tally tally;
  for (int i = 0; i < 12'000 && !testing::Test::HasFatalFailure(); ++i) {
    constexpr std::array kMeshes = {-600, -100, 0, 0, 60, 120};
    const MeshFrame frame{{0, 0, 0}, kMeshes[static_cast<std::size_t>(Int(0, 5))]};
    const double mesh = std::ldexp(1, frame.exponent);
    const int small = Int(0, 3) == 0 ? Int(0, 400) : Int(0, 24);
    const double size = std::ldexp(mesh, -small);
    // Few bits make exact meetings, many make near ones.
    const double unit = std::ldexp(size, Int(0, 1) == 0 ? -2 : -20);
    // Tiny triangles lie at the middle of the frame, where doubles are fine enough for them.
    const Vec3d place =
        small > 30 ? Vec3d{} : Multiple({}, mesh / 2, std::max(unit, mesh * 0x1p-20));
    const auto point = [&] { return Multiple(place, size / 2, unit); };
    const Vec3d a = point(), b = point();
    const std::array<TriangleCorners, 2> triangles{TriangleCorners{a, b, point()}, {b, a, point()}};
    constexpr std::array kWeights = {0.0, 0.5, 1.0, 0.25};
    const double w = kWeights[static_cast<std::size_t>(Int(0, 3))];
    const Vec3d target =
        Between(triangles[0][2], Between(a, b, w), kWeights[static_cast<std::size_t>(Int(0, 2))]);
    Ray ray;
    ray.direction = {double(Int(-9, 9)), double(Int(-9, 9)), double(Int(-9, 9))};
    if (Int(0, 2) == 0) ray.direction = {0, 0, Int(0, 1) ? 1.0 : -1.0};
    if (Int(0, 5) == 0) ray.direction = {Real(-1, 1), Real(-1, 1), Real(-1, 1)};
    constexpr std::array kDistances = {-1000, -20, 0, 1, 3, 20, 45, 47, 53, 60, 200, 900};
    const int away = kDistances[static_cast<std::size_t>(Int(0, 11))];
    const double distance = away == -1000 ? 0 : std::ldexp(Int(0, 4) ? size : mesh, away);
    ray.origin = target - ray.direction * distance;
    const int longer = Int(0, 2) == 0 ? Int(-900, 900) : 0;
    for (int axis = 0; axis < 3; ++axis) {
      ray.direction[axis] = std::ldexp(ray.direction[axis], longer);
    }
    ray.t_min = -std::numeric_limits<double>::infinity();
    if (!IsValid(ray)) continue;
    // Ends at the t that is answered, and next to it.
    if (const auto t = RationalHit(ray, triangles[0])) {
      const double end = RoundedToNearest(*t);
      switch (Int(0, 4)) {
        case 0:
          ray.t_max = end;
          break;
        case 1:
          ray.t_min = end;
          break;
        case 2:
          ray.t_max = std::nextafter(end, -1e300);
          break;
        case 3:
          ray.t_min = std::min(std::nextafter(end, 1e300), ray.t_max);
          break;
        default:
          break;
      }
    }
    Check(ray, triangles, frame, &tally);
  }
  EXPECT_GT(tally.hits, 3'000);
}

// So far away that the mesh is smaller than the rounding of the way to it: only the numbers as
// given tell whether the ray, which goes through the origin or a power of two beside it, hits.
TEST(ExactIntersection, AgreesWithRationalsForOriginsFartherThanTheDigitsOfDouble) {
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
    Check(ray, triangles, frame, &tally);
  }
  EXPECT_GT(tally.hits, 500);
}

std::size_t& GmpAllocations() {
  static std::size_t count = 0;
  return count;
}

TEST(ExactIntersection, AllocatesNothingHoweverDegenerateRaysAre) {
  const MeshFrame frame{{0, 0, 0}, 3};
  const auto point = [] { return Vec3d{Int(-3, 3) / 3.0, Int(-3, 3) / 3.0, Int(-3, 3) / 3.0}; };
  mp_set_memory_functions(
      [](std::size_t size) {
        ++GmpAllocations();
        return std::malloc(size);
      },
      nullptr, nullptr);
  const test::AllocationPeak peak;
  int hits = 0, ties = 0;
  for (int i = 0; i < 5'000; ++i) {
    const Vec3d a = point(), b = point(), c = point(), d = point();
    Ray ray;
    ray.origin = Int(0, 1) ? point() : a - point() * 0x1p50;
    ray.direction = a - ray.origin;
    if (!IsValid(ray)) continue;
    const auto local = ExactIntersection::MakeRay(ray, frame);
    if (!local) continue;
    const ExactIntersection test(*local);
    const auto corners = [&](PrimitiveId id) {
      return id == 0 ? ExactIntersection::Corners{a, b, c} : ExactIntersection::Corners{d, c, b};
    };
    ExactIntersection::Hit first, second;
    if (!test.Test(a, b, c, &first)) continue;
    hits += test.Finish(first, 0, corners).IsHit() ? 1 : 0;
    if (test.Test(d, c, b, &second)) ties += test.IsCloser(first, 0, second, 1, corners) ? 1 : 0;
  }
  mp_set_memory_functions(nullptr, nullptr, nullptr);
  EXPECT_GT(hits, 500);
  EXPECT_GT(ties, 20);
  EXPECT_EQ(GmpAllocations(), 0u);
  EXPECT_EQ(peak.bytes(), 0u);
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

TEST(Dyadic, QuotientsAgreeWithRationalsDownToTheSmallestDouble) {
  for (int i = 0; i < 5'000; ++i) {
    const auto number = [](int range) { return std::ldexp(Real(-1, 1), Int(-range, range)); };
    const double a = number(400), b = number(400), c = number(400), d = number(200);
    const Dyadic numerator = Dyadic(a) * Dyadic(b) + Dyadic(c) * Dyadic(d);
    const mpq_class exact = (mpq_class(a) * mpq_class(b) + mpq_class(c) * mpq_class(d));
    for (const double divisor : {1.0, 3.0, d, a}) {
      if (divisor == 0) continue;
      const double got = Dyadic::Quotient(numerator, Dyadic(divisor));
      const double want = RoundedToNearest(exact / mpq_class(divisor));
      ASSERT_EQ(std::clamp(got, -1.7976931348623157e308, 1.7976931348623157e308), want);
    }
    const double sum = (numerator - Dyadic(a) * Dyadic(b)).ToDouble();
    ASSERT_EQ(sum, RoundedToNearest(mpq_class(c) * mpq_class(d)));
    const double coarse =
        Dyadic::Quotient(Dyadic(Real(-1, 1)), Dyadic(Real(0.1, 1)), -8).ToDouble();
    ASSERT_EQ(coarse, std::trunc(coarse * 256) / 256);
  }
  EXPECT_EQ(Dyadic::Quotient(Dyadic(0x1p-1074), Dyadic(2.0)), 0);
  EXPECT_EQ(Dyadic::Quotient(Dyadic(0x3p-1074), Dyadic(2.0)), 0x1p-1073);
  EXPECT_EQ(Dyadic::Quotient(Dyadic(0x1p-1074), Dyadic(1.9)), 0x1p-1074);
  EXPECT_EQ(Dyadic::Quotient(Dyadic(7.0), Dyadic(2.0), -1).ToDouble(), 3.5);
  EXPECT_EQ(Dyadic::Quotient(Dyadic(-7.0), Dyadic(2.0), 0).ToDouble(), -3);
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
