// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/clip.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "tests/support/seed.h"

namespace kdray::test {
namespace {

using core::Bounds3f;
using core::ClippedBounds;
using core::ClippedHalfBounds;
using core::Vec3d;
using core::Vec3f;
using Triangle = std::array<Vec3d, 3>;
using Vec3l = core::Vec3<long double>;

int Uniform(std::mt19937_64& engine, int low, int high) {
  return low + static_cast<int>(engine() % static_cast<std::uint64_t>(high - low + 1));
}

// Small integers: sums and products of theirs are exact, and many triangles touch the box's faces,
// edges and corners.
Vec3d IntegerPoint(std::mt19937_64& engine, int range) {
  const double x = Uniform(engine, -range, range);
  const double y = Uniform(engine, -range, range);
  const double z = Uniform(engine, -range, range);
  return {x, y, z};
}

// What rounding may do to the oracle below.
constexpr long double kOracleSlack = 0x1p-57L;

// Every corner that triangle and box can have in common, found one by one: corners of the triangle
// in the box, its edges at the box's faces, the box's edges at its plane.
std::vector<Vec3l> CommonCorners(const Triangle& triangle, const Bounds3f& box) {
  const Vec3l low(box.min), high(box.max);
  const auto in_box = [&](const Vec3l& p, int except) {
    for (int axis = 0; axis < 3; ++axis) {
      // A point at a corner of the box may have been rounded off it.
      if (axis != except &&
          (p[axis] < low[axis] - kOracleSlack || p[axis] > high[axis] + kOracleSlack)) {
        return false;
      }
    }
    return true;
  };
  std::array<Vec3l, 3> corner;
  for (std::size_t i = 0; i < 3; ++i) corner[i] = Vec3l(triangle[i]);

  std::vector<Vec3l> found;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3l& a = corner[i];
    const Vec3l& b = corner[(i + 1) % 3];
    if (in_box(a, -1)) found.push_back(a);
    for (int axis = 0; axis < 3; ++axis) {
      for (const long double plane : {low[axis], high[axis]}) {
        if ((a[axis] < plane) == (b[axis] < plane)) continue;
        const long double s = (plane - a[axis]) / (b[axis] - a[axis]);
        Vec3l p = a + (b - a) * s;
        p[axis] = plane;
        if (in_box(p, axis)) found.push_back(p);
      }
    }
  }
  const Vec3l normal = Cross(corner[1] - corner[0], corner[2] - corner[0]);
  for (int axis = 0; axis < 3; ++axis) {
    if (normal[axis] == 0) continue;
    const int j = (axis + 1) % 3, k = (axis + 2) % 3;
    for (const long double pj : {low[j], high[j]}) {
      for (const long double pk : {low[k], high[k]}) {
        Vec3l p = corner[0];
        p[j] = pj;
        p[k] = pk;
        p[axis] -=
            (normal[j] * (pj - corner[0][j]) + normal[k] * (pk - corner[0][k])) / normal[axis];
        if (!in_box(p, -1)) continue;
        // Inside the triangle: the same side of all three edges, in the projection along the axis.
        int left = 0, right = 0;
        for (std::size_t i = 0; i < 3; ++i) {
          const Vec3l& a = corner[i];
          const Vec3l& b = corner[(i + 1) % 3];
          const long double side = (b[j] - a[j]) * (p[k] - a[k]) - (b[k] - a[k]) * (p[j] - a[j]);
          left += side > 0;
          right += side < 0;
        }
        if (left == 0 || right == 0) found.push_back(p);
      }
    }
  }
  return found;
}

TEST(ClippedBounds, HoldEveryCommonCornerAndAreTight) {
  std::mt19937_64 engine = RandomEngine(1);
  int together = 0, apart = 0;
  for (int trial = 0; trial < 200'000; ++trial) {
    const Triangle triangle = {IntegerPoint(engine, 12), IntegerPoint(engine, 12),
                               IntegerPoint(engine, 12)};
    if (Cross(triangle[1] - triangle[0], triangle[2] - triangle[0]) == Vec3d{}) continue;
    Bounds3f box = Bounds3f::Empty();
    box.Extend(Vec3f(IntegerPoint(engine, 8)));
    box.Extend(Vec3f(IntegerPoint(engine, 8)));

    const Bounds3f clipped = ClippedBounds(triangle, box);
    const std::vector<Vec3l> corners = CommonCorners(triangle, box);
    if (corners.empty()) {
      // Points in common would have been found; at this size nothing passes within 2^-40.
      EXPECT_TRUE(clipped.IsEmpty()) << "trial " << trial;
      ++apart;
      continue;
    }
    ++together;
    ASSERT_FALSE(clipped.IsEmpty()) << "trial " << trial;
    for (int axis = 0; axis < 3; ++axis) {
      long double low = corners.front()[axis], high = low;
      for (const Vec3l& p : corners) {
        low = std::min(low, p[axis]);
        high = std::max(high, p[axis]);
      }
      ASSERT_LE(static_cast<long double>(clipped.min[axis]), low + kOracleSlack)
          << "trial " << trial;
      ASSERT_GE(static_cast<long double>(clipped.max[axis]), high - kOracleSlack)
          << "trial " << trial;
      // Rounding outward to float costs 2^-20 at most at this size.
      EXPECT_GE(static_cast<long double>(clipped.min[axis]), low - 0x1p-20L) << "trial " << trial;
      EXPECT_LE(static_cast<long double>(clipped.max[axis]), high + 0x1p-20L) << "trial " << trial;
      EXPECT_GE(clipped.min[axis], box.min[axis]);
      EXPECT_LE(clipped.max[axis], box.max[axis]);
    }
  }
  EXPECT_GT(together, 10'000);
  EXPECT_GT(apart, 10'000);
}

// Both halves of a box, against the corners found one by one: nothing may be lost, and little is
// to spare.
TEST(ClippedHalfBounds, HoldEveryCommonCornerAndAreNearlyTight) {
  std::mt19937_64 engine = RandomEngine(3);
  int together = 0, apart = 0, loose = 0;
  for (int trial = 0; trial < 200'000; ++trial) {
    const Triangle triangle = {IntegerPoint(engine, 12), IntegerPoint(engine, 12),
                               IntegerPoint(engine, 12)};
    if (Cross(triangle[1] - triangle[0], triangle[2] - triangle[0]) == Vec3d{}) continue;
    Bounds3f box = Bounds3f::Empty();
    box.Extend(Vec3f(IntegerPoint(engine, 8)));
    box.Extend(Vec3f(IntegerPoint(engine, 8)));
    const int axis = Uniform(engine, 0, 2);
    const float position = static_cast<float>(
        Uniform(engine, static_cast<int>(box.min[axis]), static_cast<int>(box.max[axis])));
    const Bounds3f bounds = ClippedBounds(triangle, box);
    if (bounds.IsEmpty()) continue;

    const core::ClippedHalves halves = ClippedHalfBounds(triangle, box, bounds, axis, position);
    Bounds3f half[2] = {box, box};
    half[0].max[axis] = position;
    half[1].min[axis] = position;
    const Bounds3f* clipped[2] = {&halves.below, &halves.above};
    for (int side = 0; side < 2; ++side) {
      const std::vector<Vec3l> corners = CommonCorners(triangle, half[side]);
      if (corners.empty()) {
        ++apart;
        continue;  // a triangle that passes so near that floats cannot tell may have bounds
      }
      ++together;
      ASSERT_FALSE(clipped[side]->IsEmpty()) << "trial " << trial;
      // 2^-18 of the extent and 2^-19 of the place, and that again along slopes of up to 30; a
      // triangle more nearly parallel to a face may be off farther.
      const long double spare = 24 * 0x1p-13L;
      for (int k = 0; k < 3; ++k) {
        long double low = corners.front()[k], high = low;
        for (const Vec3l& p : corners) {
          low = std::min(low, p[k]);
          high = std::max(high, p[k]);
        }
        const long double min = clipped[side]->min[k], max = clipped[side]->max[k];
        ASSERT_LE(min, low + kOracleSlack) << "trial " << trial;
        ASSERT_GE(max, high - kOracleSlack) << "trial " << trial;
        loose += min < low - spare;
        loose += max > high + spare;
        EXPECT_GE(clipped[side]->min[k], std::max(half[side].min[k], bounds.min[k]));
        EXPECT_LE(clipped[side]->max[k], std::min(half[side].max[k], bounds.max[k]));
      }
    }
  }
  EXPECT_GT(together, 10'000);
  EXPECT_GT(apart, 1'000);
  EXPECT_LT(loose, together / 100) << "of " << together;
}

// Triangles of every size anywhere, as doubles that no float holds: the halves contain what the
// exact clipping finds, also where the cut is cut again and again.
TEST(ClippedHalfBounds, LoseNothingWhenTheyAreCutAgain) {
  std::mt19937_64 engine = RandomEngine(4);
  const auto unit = [&] { return std::ldexp(static_cast<double>(engine() >> 11), -52) - 1; };
  int cuts = 0;
  for (int trial = 0; trial < 20'000; ++trial) {
    const double size = std::ldexp(1.0, -Uniform(engine, 0, 30));
    const Vec3d place = {unit(), unit(), unit()};
    const auto corner = [&] { return place + Vec3d{unit(), unit(), unit() * unit()} * size; };
    const Triangle triangle = {corner(), corner(), corner()};
    Bounds3f box{{-4, -4, -4}, {4, 4, 4}};
    Bounds3f bounds = ClippedBounds(triangle, box);
    for (int cut = 0; cut < 10; ++cut) {
      const int axis = Uniform(engine, 0, 2);
      const float position = bounds.min[axis] + (bounds.max[axis] - bounds.min[axis]) *
                                                    static_cast<float>(unit() * 0.5 + 0.5);
      if (!(box.min[axis] < position && position < box.max[axis])) continue;
      const core::ClippedHalves halves = ClippedHalfBounds(triangle, box, bounds, axis, position);
      const bool below = engine() % 2 == 0;
      (below ? box.max : box.min)[axis] = position;
      bounds = below ? halves.below : halves.above;
      for (const Vec3l& p : CommonCorners(triangle, box)) {
        // Only corners that are surely in the box.
        if (!core::Bounds3<long double>{Vec3l(box.min), Vec3l(box.max)}.Contains(p)) continue;
        for (int k = 0; k < 3; ++k) {
          ASSERT_LE(static_cast<long double>(bounds.min[k]), p[k] + kOracleSlack) << trial;
          ASSERT_GE(static_cast<long double>(bounds.max[k]), p[k] - kOracleSlack) << trial;
        }
      }
      ++cuts;
      if (bounds.IsEmpty()) break;
    }
  }
  EXPECT_GT(cuts, 50'000);
}

// An edge almost parallel to a face: a rounding of 2^-53 across moves the crossing by far more
// along. Every point of such a triangle that is in the box must stay in the bounds.
TEST(ClippedBounds, SurviveEdgesNearlyParallelToAFace) {
  std::mt19937_64 engine = RandomEngine(2);
  const auto tiny = [&] { return std::ldexp(Uniform(engine, -8, 8), -53); };
  const auto eighths = [&] { return Uniform(engine, -8, 8) / 8.0; };
  for (int trial = 0; trial < 100'000; ++trial) {
    const Triangle triangle = {Vec3d{eighths(), 0.5 + tiny(), eighths()},
                               Vec3d{eighths(), 0.5 + tiny(), eighths()},
                               Vec3d{eighths(), 0.5 + tiny(), eighths()}};
    const Bounds3f box{{-0.3f, -0.3f, -0.3f}, {0.7f, 0.5f, 0.7f}};
    const Bounds3f clipped = ClippedBounds(triangle, box);
    // Corners and edge middles, with coordinates that are exact.
    for (std::size_t i = 0; i < 3; ++i) {
      const Vec3d& a = triangle[i];
      const Vec3d middle = a * 0.5 + triangle[(i + 1) % 3] * 0.5;
      for (const Vec3d& p : {a, middle}) {
        if (!core::Bounds3d{Vec3d(box.min), Vec3d(box.max)}.Contains(p)) continue;
        ASSERT_TRUE((core::Bounds3d{Vec3d(clipped.min), Vec3d(clipped.max)}.Contains(p)))
            << "trial " << trial;
      }
    }
  }
}

TEST(ClippedBounds, OfATriangleInsideTheBoxAreItsOwn) {
  const Triangle triangle = {Vec3d{0.1, 0.2, 0.3}, Vec3d{0.5, -0.25, 0.125}, Vec3d{0, 0, 0}};
  const Bounds3f box{{-1, -1, -1}, {1, 1, 1}};
  const Bounds3f own{{0, -0.25f, 0}, {0.5f, core::RoundUp(0.2), core::RoundUp(0.3)}};
  EXPECT_EQ(ClippedBounds(triangle, box), own);
}

// A cut at a grid line must not leave a sliver behind on the other side.
TEST(ClippedBounds, KeepCornersThatAreExact) {
  const Triangle triangle = {Vec3d{0.25, 0, 0}, Vec3d{0.5, 0, 0}, Vec3d{0.25, 1, 0.5}};
  const Bounds3f clipped = ClippedBounds(triangle, Bounds3f{{-1, 0.3f, -1}, {1, 0.7f, 1}});
  EXPECT_EQ(clipped.min.x, 0.25f);
  EXPECT_EQ(clipped.min.y, 0.3f);
  EXPECT_EQ(clipped.max.y, 0.7f);
}

TEST(ClippedBounds, AreFlatOnAFaceThatTheTriangleTouches) {
  const Triangle triangle = {Vec3d{1, 0.25, 0.25}, Vec3d{2, 0.5, 0.5}, Vec3d{2, 0.75, 0.25}};
  const Bounds3f box{{0, 0, 0}, {1, 1, 1}};
  const Bounds3f clipped = ClippedBounds(triangle, box);
  ASSERT_FALSE(clipped.IsEmpty());
  EXPECT_EQ(clipped.min.x, 1);
  EXPECT_EQ(clipped.max.x, 1);
  EXPECT_LE(clipped.min.y, 0.25f);
  EXPECT_GE(clipped.max.y, 0.25f);
  EXPECT_NEAR(clipped.min.y, 0.25f, 1e-6f);
  EXPECT_NEAR(clipped.max.y, 0.25f, 1e-6f);
}

TEST(ClippedBounds, AreEmptyForATriangleThatPassesACorner) {
  // Its own bounds reach into the box, but it cuts across in front of it.
  const Triangle triangle = {Vec3d{0.9, 2, 0.5}, Vec3d{2, 0.9, 0.5}, Vec3d{2, 2, 0.5}};
  EXPECT_TRUE(ClippedBounds(triangle, Bounds3f{{0, 0, 0}, {1, 1, 1}}).IsEmpty());
}

TEST(ClippedBounds, DoNotDependOnTheScale) {
  const Triangle triangle = {Vec3d{-1, 0.3, 0.1}, Vec3d{0.7, -1, 0.4}, Vec3d{0.2, 0.9, -0.8}};
  const Bounds3f box{{-0.5f, -0.25f, -0.125f}, {0.125f, 0.5f, 0.25f}};
  const Bounds3f clipped = ClippedBounds(triangle, box);
  ASSERT_FALSE(clipped.IsEmpty());
  for (int exponent = -100; exponent <= 0; ++exponent) {
    const double scale = std::ldexp(1.0, exponent);
    const float scale_f = static_cast<float>(scale);
    const Triangle small = {triangle[0] * scale, triangle[1] * scale, triangle[2] * scale};
    EXPECT_EQ(ClippedBounds(small, Bounds3f{box.min * scale_f, box.max * scale_f}),
              (Bounds3f{clipped.min * scale_f, clipped.max * scale_f}))
        << exponent;
  }
}

// Doubles reach far below the floats; what is left of a triangle there is still held.
TEST(ClippedBounds, HoldTrianglesTooSmallForFloats) {
  const double s = 0x1p-1060;
  const Triangle triangle = {Vec3d{-s, -s, s}, Vec3d{s, -s, s}, Vec3d{0, s, -s}};
  const Bounds3f box{{0, 0, 0}, {1, 1, 1}};
  const Bounds3f clipped = ClippedBounds(triangle, box);
  ASSERT_FALSE(clipped.IsEmpty());
  EXPECT_GT(clipped.max.x, 0);
  EXPECT_GT(clipped.max.y, 0);
}

}  // namespace
}  // namespace kdray::test
