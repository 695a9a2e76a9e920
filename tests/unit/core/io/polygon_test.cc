// SPDX-License-Identifier: Apache-2.0
#include "core/io/polygon.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "tests/support/cancel_probe.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

using testing::ElementsAre;

MeshData Cut(const std::vector<Vec3d>& polygon) {
  MeshData data;
  data.vertices = polygon;
  std::vector<std::uint32_t> corners(polygon.size());
  std::iota(corners.begin(), corners.end(), 0u);
  PolygonCutter cutter(&data, {});
  EXPECT_TRUE(cutter.Add(corners).ok());
  return data;
}

std::vector<Vec3d> InPlaneZ(const std::vector<Point2>& path) {
  std::vector<Vec3d> polygon;
  for (const Point2 p : path) polygon.push_back({p.x, p.y, 0});
  return polygon;
}

// Twice the signed area; exact for small whole numbers.
double DoubleArea(Point2 a, Point2 b, Point2 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}
double DoubleArea(const std::vector<Point2>& path) {
  double sum = 0;
  for (std::size_t i = 2; i < path.size(); ++i) sum += DoubleArea(path[0], path[i - 1], path[i]);
  return sum;
}

// The oracle for a simple path without repeated corners: as many triangles as there must be, each
// with area and turning the way the path does, and together as large as the region. Then they
// overlap nowhere and cover it.
void ExpectCutsWell(const std::vector<Point2>& path) {
  const MeshData data = Cut(InPlaneZ(path));
  ASSERT_EQ(data.triangles.size(), path.size() - 2);
  const double area = DoubleArea(path);
  double sum = 0;
  for (const auto& [a, b, c] : data.triangles) {
    const double part = DoubleArea(path[a], path[b], path[c]);
    ASSERT_GT(part * area, 0) << "triangle " << a << ' ' << b << ' ' << c;
    sum += part;
  }
  ASSERT_EQ(sum, area);
}

bool SegmentsMeet(Point2 a, Point2 b, Point2 c, Point2 d) {
  const int abc = Orient2d(a, b, c);
  const int abd = Orient2d(a, b, d);
  const int cda = Orient2d(c, d, a);
  const int cdb = Orient2d(c, d, b);
  if (abc != abd && cda != cdb && abc * abd <= 0 && cda * cdb <= 0) return true;
  if (abc != 0 || abd != 0) return false;
  const auto between = [](Point2 p, Point2 q, Point2 r) {
    return std::min(p.x, q.x) <= r.x && r.x <= std::max(p.x, q.x) && std::min(p.y, q.y) <= r.y &&
           r.y <= std::max(p.y, q.y);
  };
  return between(a, b, c) || between(a, b, d) || between(c, d, a);
}

// Neighbours share their corner only, others nothing.
bool IsSimple(const std::vector<Point2>& path) {
  const std::size_t n = path.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Point2 a = path[i];
    const Point2 b = path[(i + 1) % n];
    const Point2 c = path[(i + 2) % n];
    if (a == b) return false;
    if (Orient2d(a, b, c) == 0 && (b.x - a.x) * (c.x - b.x) + (b.y - a.y) * (c.y - b.y) < 0) {
      return false;
    }
    for (std::size_t j = i + 2; j < n; ++j) {
      if (i == 0 && j == n - 1) continue;
      if (SegmentsMeet(a, b, path[j], path[(j + 1) % n])) return false;
    }
  }
  return true;
}

std::vector<Point2> RegularPath(int n, double radius) {
  std::vector<Point2> path;
  for (int i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n;
    path.push_back({radius * std::cos(angle), radius * std::sin(angle)});
  }
  return path;
}

TEST(IsConvexPath, AcceptsConvexPathsWithStraightAndRepeatedCorners) {
  EXPECT_TRUE(IsConvexPath(std::vector<Point2>{{0, 0}, {1, 0}, {1, 1}, {0, 1}}));
  EXPECT_TRUE(IsConvexPath(std::vector<Point2>{{0, 0}, {1, 0}, {2, 0}, {2, 2}, {0, 2}, {0, 1}}));
  EXPECT_TRUE(IsConvexPath(std::vector<Point2>{{0, 0}, {0, 0}, {1, 0}, {1, 0}, {0, 1}, {0, 0}}));
  EXPECT_TRUE(IsConvexPath(std::vector<Point2>{{1, 1}, {1, 1}, {1, 1}, {1, 1}}));
  for (const int n : {3, 4, 5, 12, 1000}) EXPECT_TRUE(IsConvexPath(RegularPath(n, 3.7)));
}

TEST(IsConvexPath, RejectsDentsSpikesSecondRoundsAndTheOtherDirection) {
  EXPECT_FALSE(IsConvexPath(std::vector<Point2>{{0, 0}, {4, 0}, {1, 1}, {0, 4}}));
  EXPECT_FALSE(IsConvexPath(std::vector<Point2>{{0, 0}, {0, 1}, {1, 1}, {1, 0}}));
  EXPECT_FALSE(IsConvexPath(std::vector<Point2>{{0, 0}, {2, 0}, {1, 0}, {1, 1}}));
  EXPECT_FALSE(IsConvexPath(std::vector<Point2>{{0, 0}, {3, 0}, {5, 0}, {3, 0}, {3, 3}, {0, 3}}));
  std::vector<Point2> star = RegularPath(5, 1);  // a pentagram: left turns only, two rounds
  star = {star[0], star[2], star[4], star[1], star[3]};
  EXPECT_FALSE(IsConvexPath(star));
  std::vector<Point2> twice = RegularPath(6, 1);
  twice.insert(twice.end(), twice.begin(), twice.begin() + 6);
  EXPECT_FALSE(IsConvexPath(twice));
}

TEST(PolygonCutter, FansAConvexPolygonFromItsFirstCorner) {
  const MeshData data = Cut(InPlaneZ(RegularPath(6, 1)));
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{0, 2, 3},
                                          TriangleIndices{0, 3, 4}, TriangleIndices{0, 4, 5}));
  EXPECT_EQ(data.concave, 0u);
}

TEST(PolygonCutter, FansAConvexPolygonInAnyPlaneAndAtAnyScale) {
  std::mt19937_64 random = test::RandomEngine(20);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (const double scale : {1e-300, 1e-160, 1e-30, 1.0, 1e30, 1e38}) {
    for (int round = 0; round < 20; ++round) {
      const Vec3d u = Normalized(Vec3d{unit(random), unit(random), unit(random)});
      const Vec3d v = Normalized(Cross(u, Vec3d{unit(random), unit(random), unit(random)}));
      std::vector<Vec3d> polygon;
      for (const Point2 p : RegularPath(9, 1)) polygon.push_back((u * p.x + v * p.y) * scale);
      EXPECT_EQ(Cut(polygon).concave, 0u);
      EXPECT_EQ(Cut(polygon).triangles[6], (TriangleIndices{0, 7, 8}));
      std::reverse(polygon.begin(), polygon.end());
      EXPECT_EQ(Cut(polygon).concave, 0u);
      polygon[4] = (polygon[3] + polygon[5]) * 0.3;  // a clear dent
      EXPECT_EQ(Cut(polygon).concave, 1u) << scale;
    }
  }
}

TEST(PolygonCutter, FansAWarpedQuadThatIsConvexSeenAgainstItsNormal) {
  const MeshData data = Cut({{0, 0, 0}, {1, 0, 0.2}, {1, 1, -0.2}, {0, 1, 0.1}});
  EXPECT_THAT(data.triangles, ElementsAre(TriangleIndices{0, 1, 2}, TriangleIndices{0, 2, 3}));
  EXPECT_EQ(data.concave, 0u);
}

TEST(PolygonCutter, CutsADentedQuadAlongItsInnerDiagonal) {
  for (std::size_t start = 0; start < 4; ++start) {
    std::vector<Point2> path = {{0, 0}, {4, 0}, {1, 1}, {0, 4}};
    std::rotate(path.begin(), path.begin() + static_cast<std::ptrdiff_t>(start), path.end());
    ExpectCutsWell(path);
    EXPECT_EQ(Cut(InPlaneZ(path)).concave, 1u);
    std::reverse(path.begin(), path.end());
    ExpectCutsWell(path);
  }
}

TEST(PolygonCutter, CutsEverySimplePolygonOfRandomGridPointsIntoPartsThatCoverIt) {
  std::mt19937_64 random = test::RandomEngine(21);
  int simple = 0;
  for (int round = 0; round < 60000; ++round) {
    const int n = 4 + round % 6;
    std::uniform_int_distribution<int> grid(0, round % 2 == 0 ? 3 : 6);
    std::vector<Point2> path;
    for (int i = 0; i < n; ++i) {
      path.push_back({static_cast<double>(grid(random)), static_cast<double>(grid(random))});
    }
    if (!IsSimple(path)) continue;
    ++simple;
    if (IsConvexPath(path))
      continue;  // a fan may have triangles without area along a straight edge
    std::vector<Point2> reversed(path.rbegin(), path.rend());
    if (IsConvexPath(reversed)) continue;
    ExpectCutsWell(path);
    if (HasFatalFailure()) {
      for (const Point2 p : path) ADD_FAILURE() << p.x << ' ' << p.y;
      return;
    }
  }
  EXPECT_GT(simple, 2000);
}

TEST(PolygonCutter, CutsCombsSpiralsAndStars) {
  std::vector<Point2> comb;
  for (int i = 0; i < 200; ++i) {
    comb.push_back({2.0 * i, 0});
    comb.push_back({2.0 * i + 1, 100});
  }
  comb.push_back({400, -1});
  comb.push_back({0, -1});
  std::reverse(comb.begin(), comb.end());
  ASSERT_TRUE(IsSimple(comb));
  ExpectCutsWell(comb);

  std::vector<Point2> spiral;  // a corridor of width 1 that winds inward
  const auto corner = [](int i, double inset) {
    const double r = 100 - 2 * (i / 4) - inset;
    const double next = 100 - 2 * ((i + 3) / 4) - inset;
    return i % 4 == 0   ? Point2{-next, -r}
           : i % 4 == 1 ? Point2{r, -r}
           : i % 4 == 2 ? Point2{r, r}
                        : Point2{-r, r};
  };
  for (int i = 0; i < 100; ++i) spiral.push_back(corner(i, 0));
  for (int i = 99; i >= 0; --i) spiral.push_back(corner(i, 1));
  ASSERT_TRUE(IsSimple(spiral));
  ExpectCutsWell(spiral);

  std::vector<Point2> star;
  for (int i = 0; i < 64; ++i) {
    const double angle = 2 * std::numbers::pi * i / 64;
    const double radius = i % 2 == 0 ? 1000 : 300;
    star.push_back({std::round(radius * std::cos(angle)), std::round(radius * std::sin(angle))});
  }
  ASSERT_TRUE(IsSimple(star));
  ExpectCutsWell(star);
}

TEST(PolygonCutter, CutsAPolygonWithAHoleBehindABridge) {
  // A square with a square hole, the bridge there and back between (0, 0) and (1, 1); once with a
  // corner in the middle of one of its sides.
  for (const bool middle : {false, true}) {
    std::vector<Point2> path = {{0, 0}, {3, 0}, {3, 3}, {0, 3}, {0, 0}};
    if (middle) path.push_back({0.5, 0.5});
    path.insert(path.end(), {{1, 1}, {1, 2}, {2, 2}, {2, 1}, {1, 1}});
    const MeshData data = Cut(InPlaneZ(path));
    ASSERT_EQ(data.triangles.size(), path.size() - 2);
    double sum = 0;
    for (const auto& [a, b, c] : data.triangles) {
      const double part = DoubleArea(path[a], path[b], path[c]);
      EXPECT_GE(part, 0);
      sum += part;
    }
    EXPECT_EQ(sum, 2 * (9 - 1));
  }
}

TEST(PolygonCutter, AlwaysMakesTwoTrianglesFewerThanCornersWhateverTheInput) {
  std::mt19937_64 random = test::RandomEngine(22);
  std::uniform_int_distribution<int> grid(0, 2);
  for (int round = 0; round < 20000; ++round) {
    const std::size_t n = 4 + static_cast<std::size_t>(round % 9);
    std::vector<Vec3d> polygon;
    for (std::size_t i = 0; i < n; ++i) {
      polygon.push_back({static_cast<double>(grid(random)), static_cast<double>(grid(random)),
                         static_cast<double>(round % 3 == 0 ? grid(random) : 0)});
    }
    const MeshData data = Cut(polygon);
    ASSERT_EQ(data.triangles.size(), n - 2);
    // Every corner is used, and the boundary is kept: each edge of the path appears once, in its
    // direction, or cancels out.
    std::vector<std::vector<int>> edges(n, std::vector<int>(n));
    for (const auto& [a, b, c] : data.triangles) {
      ++edges[a][b], ++edges[b][c], ++edges[c][a];
      --edges[b][a], --edges[c][b], --edges[a][c];
    }
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        const int boundary = (j == (i + 1) % n ? 1 : 0) - (i == (j + 1) % n ? 1 : 0);
        ASSERT_EQ(edges[i][j], boundary);
      }
    }
  }
}

TEST(PolygonCutter, FansWhatHasNoNormal) {
  EXPECT_EQ(Cut({{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {1, 1, 1}}).triangles.size(), 2u);
  EXPECT_EQ(Cut({{1, 1, 1}, {1, 1, 1}, {1, 1, 1}, {1, 1, 1}}).concave, 0u);
  EXPECT_EQ(Cut({{0, 0, 0}, {NAN, 1, 1}, {2, INFINITY, 2}, {1, 1, 1}, {5, 0, 0}}).triangles.size(),
            3u);
}

TEST(PolygonCutter, DropsAndCountsFacesWithFewerThanThreeCorners) {
  EXPECT_EQ(Cut({}).dropped, 1u);
  EXPECT_EQ(Cut({{0, 0, 0}}).dropped, 1u);
  EXPECT_EQ(Cut({{0, 0, 0}, {1, 0, 0}}).dropped, 1u);
  EXPECT_TRUE(Cut({{0, 0, 0}, {1, 0, 0}}).triangles.empty());
  EXPECT_EQ(Cut({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}).dropped, 0u);
}

TEST(PolygonCutter, RefusesAConcavePolygonWithMoreCornersThanItHasMemoryFor) {
  std::vector<Point2> path = RegularPath(270000, 1);
  EXPECT_EQ(Cut(InPlaneZ(path)).triangles.size(), 269998u);
  path[5] = {0, 0};
  MeshData data;
  data.vertices = InPlaneZ(path);
  std::vector<std::uint32_t> corners(path.size());
  std::iota(corners.begin(), corners.end(), 0u);
  const Status status = PolygonCutter(&data, {}).Add(corners);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(status.error().message,
            "a concave polygon with 270000 corners; at most 262144 are allowed");
}

std::vector<Vec3d> Scribble(int n, std::uint64_t stream) {
  std::mt19937_64 random = test::RandomEngine(stream);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Vec3d> path;
  for (int i = 0; i < n; ++i) path.push_back({unit(random), unit(random), 0});
  return path;
}

TEST(PolygonCutter, BoundsTheStepsOfAllPolygonsOfAFileTogether) {
  MeshData data;
  data.vertices = Scribble(300, 23);
  std::vector<std::uint32_t> corners(data.vertices.size());
  std::iota(corners.begin(), corners.end(), 0u);
  PolygonCutter cutter(&data, {}, 20'000'000);
  int cut = 0;
  Status status;
  while ((status = cutter.Add(corners)).ok()) {
    ASSERT_LT(++cut, 1000);
  }
  EXPECT_GT(cut, 0);
  EXPECT_EQ(status.error().code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(status.error().message,
            "cutting the polygons up to this one, of 300 corners, into triangles takes more than "
            "the " +
                std::to_string(20'000'000 + PolygonCutter::kStepsPerCorner * 300 * (cut + 1)) +
                " steps allowed; polygons that cost so much cross themselves very often");
}

TEST(PolygonCutter, StopsWhenAsked) {
  std::vector<Point2> path = RegularPath(2000, 1);
  for (std::size_t i = 0; i < path.size(); i += 2) path[i] = {path[i].x / 2, path[i].y / 2};
  MeshData data;
  data.vertices = InPlaneZ(path);
  std::vector<std::uint32_t> corners(path.size());
  std::iota(corners.begin(), corners.end(), 0u);
  const CancelToken cancel = CancelToken::Cancellable();
  cancel.Cancel();
  const Status status = PolygonCutter(&data, cancel).Add(corners);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, ErrorCode::kCancelled);
}

TEST(PolygonCutter, StopsWithinAQuarterOfASecondOfItsCancellation) {
  std::vector<Vec3d> near_line;  // every decision takes exact arithmetic
  std::mt19937_64 random = test::RandomEngine(24);
  for (int i = 0; i < 65536; ++i) {
    const double x = 1 + 1e-5 * i;
    near_line.push_back({x, 0.1 * x + 0x1p-55 * static_cast<double>(random() % 5), 0});
  }
  near_line.push_back({1.3, 50, 0});
  std::shuffle(near_line.begin(), near_line.end(), random);
  for (const std::vector<Vec3d>& path :
       {near_line, Scribble(65536, 25), Scribble(256, 26), InPlaneZ(RegularPath(3000000, 1))}) {
    std::vector<std::uint32_t> corners(path.size());
    std::iota(corners.begin(), corners.end(), 0u);
    MeshData data;
    data.vertices = path;
    const auto cut_again_and_again = [&](const CancelToken& cancel) {
      PolygonCutter cutter(&data, cancel);
      Status status;
      while ((status = cutter.Add(corners)).ok()) data.triangles.clear();
      return status;
    };
    test::ExpectPrompt(test::CancelDuring(std::chrono::milliseconds(20), cut_again_and_again),
                       "a polygon of " + std::to_string(path.size()) + " corners");
  }
}

}  // namespace
}  // namespace kdray::core
