// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/predicates.h"

#include <gmpxx.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "tests/support/seed.h"

namespace kdray::core {
namespace {

// The oracle: rational arithmetic, which holds every double exactly.
int RationalOrient2d(Point2 a, Point2 b, Point2 c) {
  const mpq_class ax(a.x), ay(a.y), bx(b.x), by(b.y), cx(c.x), cy(c.y);
  const mpq_class det = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx);
  return sgn(det);
}

testing::AssertionResult AgreesWithRationals(Point2 a, Point2 b, Point2 c) {
  const int expected = RationalOrient2d(a, b, c);
  const int actual = Orient2d(a, b, c);
  if (actual == expected) return testing::AssertionSuccess();
  char text[300];
  std::snprintf(text, sizeof text, "(%a, %a) (%a, %a) (%a, %a): %d, exactly %d", a.x, a.y, b.x, b.y,
                c.x, c.y, actual, expected);
  return testing::AssertionFailure() << text;
}

TEST(Orient2d, IsPositiveForACounterclockwiseTurn) {
  EXPECT_EQ(Orient2d({0, 0}, {1, 0}, {0, 1}), 1);
  EXPECT_EQ(Orient2d({0, 0}, {0, 1}, {1, 0}), -1);
  EXPECT_EQ(Orient2d({0, 0}, {1, 1}, {2, 2}), 0);
}

TEST(Orient2d, IsRightOnEveryTripleOfASmallGrid) {
  constexpr int kSide = 4;
  const auto point = [](int i) {
    return Point2{static_cast<double>(i % kSide), static_cast<double>(i / kSide)};
  };
  for (int i = 0; i < kSide * kSide; ++i) {
    for (int j = 0; j < kSide * kSide; ++j) {
      for (int k = 0; k < kSide * kSide; ++k) {
        ASSERT_TRUE(AgreesWithRationals(point(i), point(j), point(k)));
      }
    }
  }
}

TEST(Orient2d, IsRightOneUlpBesideALine) {
  // Shewchuk's figure of the plain formula's failures: a small square of doubles around a point on
  // the line through the other two.
  const Point2 b{12, 12};
  const Point2 c{24, 24};
  for (int i = 0; i < 64; ++i) {
    for (int j = 0; j < 64; ++j) {
      const Point2 a{0.5 + i * 0x1p-53, 0.5 + j * 0x1p-53};
      ASSERT_TRUE(AgreesWithRationals(a, b, c));
      ASSERT_EQ(Orient2d(a, b, c), i == j ? 0 : i > j ? -1 : 1);
    }
  }
}

TEST(Orient2d, IsRightForRandomPointsNearALine) {
  std::mt19937_64 random = test::RandomEngine(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::uniform_int_distribution<int> nudge(-2, 2);
  for (int i = 0; i < 100000; ++i) {
    const Point2 a{unit(random), unit(random)};
    const Point2 b{unit(random), unit(random)};
    const double s = 2 * unit(random);
    Point2 c{a.x + s * (b.x - a.x), a.y + s * (b.y - a.y)};
    for (int n = nudge(random); n != 0; n -= n > 0 ? 1 : -1) c.x = std::nextafter(c.x, n * 9.0);
    ASSERT_TRUE(AgreesWithRationals(a, b, c));
    ASSERT_EQ(Orient2d(b, c, a), Orient2d(a, b, c));
    ASSERT_EQ(Orient2d(b, a, c), -Orient2d(a, b, c));
  }
}

TEST(Orient2d, IsRightWhenMagnitudesDiffer) {
  std::mt19937_64 random = test::RandomEngine(2);
  std::uniform_real_distribution<double> mantissa(0.5, 1);
  for (const int range : {30, 120, 980}) {
    std::uniform_int_distribution<int> exponent(-range / 2, range / 2);
    std::uniform_int_distribution<int> kind(0, 4);
    const auto number = [&] {
      if (kind(random) == 0) return 0.0;
      const double value = std::ldexp(mantissa(random), exponent(random));
      return kind(random) % 2 == 0 ? value : -value;
    };
    for (int i = 0; i < 30000; ++i) {
      const Point2 a{number(), number()};
      const Point2 b{number(), number()};
      ASSERT_TRUE(AgreesWithRationals(a, b, {number(), number()}));
      // Exactly on the line through a and b, where both sums are exact.
      ASSERT_TRUE(AgreesWithRationals(a, b, {2 * b.x - a.x, 2 * b.y - a.y}));
      ASSERT_TRUE(AgreesWithRationals(a, {a.x * 3, a.y * 3}, {a.x * -5, a.y * -5}));
    }
  }
}

TEST(Orient2d, DoesNotDependOnTheScale) {
  std::mt19937_64 random = test::RandomEngine(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 2000; ++i) {
    const Point2 a{unit(random), unit(random)};
    const Point2 b{unit(random), unit(random)};
    const Point2 middle{(a.x + b.x) / 2, (a.y + b.y) / 2};
    const int expected = Orient2d(a, b, middle);
    for (const int k : {-1000, -960, -500, -100, 100, 500, 1000, 1022}) {
      const auto scaled = [k](Point2 p) { return Point2{std::ldexp(p.x, k), std::ldexp(p.y, k)}; };
      // Coordinates that the scaling itself would round are no copies.
      if (scaled(scaled(a)).x == 0 && k > 0) continue;
      if (std::ldexp(scaled(middle).x, -k) != middle.x) continue;
      if (std::ldexp(scaled(middle).y, -k) != middle.y) continue;
      ASSERT_EQ(Orient2d(scaled(a), scaled(b), scaled(middle)), expected) << "2^" << k;
    }
  }
}

TEST(Orient2d, IsRightForTheLargestAndSmallestDoubles) {
  constexpr double kMax = std::numeric_limits<double>::max();
  constexpr double kMin = std::numeric_limits<double>::denorm_min();
  EXPECT_EQ(Orient2d({-kMax, -kMax}, {kMax, -kMax}, {kMax, kMax}), 1);
  EXPECT_EQ(Orient2d({-kMax, -kMax}, {0, 0}, {kMax, kMax}), 0);
  EXPECT_EQ(Orient2d({0, 0}, {kMin, 0}, {0, kMin}), 1);
  EXPECT_EQ(Orient2d({0, 0}, {kMin, kMin}, {3 * kMin, 3 * kMin}), 0);
  EXPECT_EQ(Orient2d({0, 0}, {kMin, kMin}, {3 * kMin, 2 * kMin}), -1);
}

TEST(AreCollinear, FindsEveryZeroAreaTriangleOfASmallGrid) {
  constexpr int kSide = 3;
  const auto point = [](int i) {
    return Vec3d{static_cast<double>(i % kSide), static_cast<double>(i / kSide % kSide),
                 static_cast<double>(i / (kSide * kSide))};
  };
  for (int i = 0; i < 27; ++i) {
    for (int j = 0; j < 27; ++j) {
      for (int k = 0; k < 27; ++k) {
        const Vec3d normal = Cross(point(j) - point(i), point(k) - point(i));
        ASSERT_EQ(AreCollinear(point(i), point(j), point(k)), normal == Vec3d{});
      }
    }
  }
}

TEST(AreCollinear, SeesAHeightOfOneUlp) {
  const Vec3d a{0.1, 0.2, 0.3};
  const Vec3d b{0.2, 0.4, 0.6};  // 2a
  const Vec3d c{0.4, 0.8, 1.2};  // 4a
  EXPECT_TRUE(AreCollinear(a, b, c));
  for (int axis = 0; axis < 3; ++axis) {
    Vec3d moved = c;
    moved[axis] = std::nextafter(moved[axis], 9.0);
    EXPECT_FALSE(AreCollinear(a, b, moved)) << axis;
  }
}

}  // namespace
}  // namespace kdray::core
