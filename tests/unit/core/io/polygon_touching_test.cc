// SPDX-License-Identifier: Apache-2.0
// Polygons that touch themselves: what the triangles cover, against exact areas and winding
// numbers.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <numeric>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/io/polygon.h"
#include "tests/support/seed.h"
#include "tests/unit/core/io/polygon_paths.h"

namespace kdray::core {
namespace {

// A grid of points near and off the grid's lines.
struct Sample {
  double x, y;
};
std::vector<Sample> Samples(int size) {
  std::vector<Sample> samples;
  for (int i = 0; i < 5 * size; ++i) {
    for (int j = 0; j < 5 * size; ++j) {
      samples.push_back({i / 5.0 + 0.0713 + 0.0031 * j, j / 5.0 + 0.1029 + 0.00117 * i});
    }
  }
  return samples;
}

int Covers(const Path& path, const MeshData& data, double x, double y) {
  int count = 0;
  for (const auto& [a, b, c] : data.triangles) {
    if (Winding({path[a], path[b], path[c]}, x, y) != 0) ++count;
  }
  return count;
}

// Paths whose winding numbers are 0 and one of 1 or -1 are covered once, inside. Those that go
// around some parts in one direction and around others in the other one cross themselves at
// corners; up to six corners there are always triangles that cover each part once.
void ExpectCoversByWinding(const Path& path, const std::vector<Sample>& samples, int* tried) {
  if (CrossesItself(path)) return;
  std::vector<int> windings;
  int least = 0;
  int most = 0;
  for (const Sample s : samples) {
    windings.push_back(Winding(path, s.x, s.y));
    least = std::min(least, windings.back());
    most = std::max(most, windings.back());
  }
  if (most - least > 1 && path.size() > 6) return;
  ++*tried;
  const MeshData data = Cut(path);
  ASSERT_EQ(data.triangles.size(), path.size() - 2);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    ASSERT_EQ(Covers(path, data, samples[i].x, samples[i].y), std::abs(windings[i]))
        << "at " << samples[i].x << ", " << samples[i].y << " of" << Text(path);
  }
}

TEST(PolygonTouchingItself, IsCoveredOnceForEveryPathOfUpToFiveCornersOnAGridOfNinePoints) {
  const std::vector<Sample> samples = Samples(2);
  int tried = 0;
  for (const std::size_t n : {4, 5}) {
    std::int64_t paths = 1;
    for (std::size_t i = 0; i < n; ++i) paths *= 9;
    for (std::int64_t code = 0; code < paths; ++code) {
      Path path;
      for (std::int64_t rest = code; path.size() < n; rest /= 9) {
        path.push_back({rest % 9 % 3, rest % 9 / 3});
      }
      ExpectCoversByWinding(path, samples, &tried);
      if (testing::Test::HasFatalFailure()) return;
    }
  }
  EXPECT_GT(tried, 40000);
}

TEST(PolygonTouchingItself, IsCoveredOnceForRandomPathsOfSixToEightCornersOnSmallGrids) {
  std::mt19937_64 random = test::RandomEngine(40);
  int tried = 0;
  for (const int size : {2, 3}) {
    const std::vector<Sample> samples = Samples(size);
    std::uniform_int_distribution<int> grid(0, size);
    for (int round = 0; round < 30000; ++round) {
      Path path;
      for (int i = 0; i < 6 + round % 3; ++i) path.push_back({grid(random), grid(random)});
      ExpectCoversByWinding(path, samples, &tried);
      if (HasFatalFailure()) return;
    }
  }
  EXPECT_GT(tried, 10000);
}

double Area(const MeshData& data) {
  double sum = 0;
  for (const auto& [a, b, c] : data.triangles) {
    sum +=
        Length(Cross(data.vertices[b] - data.vertices[a], data.vertices[c] - data.vertices[a])) / 2;
  }
  return sum;
}

MeshData CutTurned(const std::vector<Point2>& path, const Vec3d& u, const Vec3d& v) {
  MeshData data;
  for (const Point2 p : path) data.vertices.push_back(u * p.x + v * p.y + Vec3d{0.1, 0.7, -0.3});
  std::vector<std::uint32_t> corners(path.size());
  std::iota(corners.begin(), corners.end(), 0u);
  EXPECT_TRUE(PolygonCutter(&data, {}).Add(corners).ok());
  EXPECT_EQ(data.triangles.size(), path.size() - 2);
  return data;
}

TEST(PolygonTouchingItself, LosesOnlyWhatRoundingMovedInPlanesThatAreNotExact) {
  std::mt19937_64 random = test::RandomEngine(43);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<Point2> comb = {{0, 0}, {400, 0}};  // its gaps reach down to its base line
  for (int i = 399; i >= 0; --i) {
    comb.push_back({i + 0.5, 100});
    if (i > 0) comb.push_back({static_cast<double>(i), 0});
  }
  const std::vector<std::vector<Point2>> paths = {
      // A corner on an edge, from near and from far; a dent that reaches the left side; loops that
      // meet in a point; a hole there; a line out and back.
      {{0, 0}, {6, 0}, {6, 4}, {3, 0}, {0, 4}},
      {{0, 0}, {6, 0}, {6, 4}, {5, 10}, {3, 0}, {1, 10}, {0, 4}},
      {{0, 0}, {7, 0}, {7, 7}, {3, 7}, {3, 5}, {4, 5}, {2, 3}, {0, 5}, {1, 5}, {1, 7}, {0, 7}},
      {{0, 3}, {0, 0}, {-2, 0}, {0, -2}, {0, 0}, {8, 2}},
      {{0, 0}, {9, 0}, {9, 9}, {4, 4}, {5, 2}, {3, 2}, {4, 4}, {0, 9}},
      {{0, 0}, {4, 0}, {6, 1}, {4, 0}, {0, 4}},
      comb};
  for (const std::vector<Point2>& path : paths) {
    double area = 0;
    for (std::size_t i = 0; i < path.size(); ++i) {
      const Point2 p = path[i];
      const Point2 q = path[(i + 1) % path.size()];
      area += (p.x * q.y - p.y * q.x) / 2;
    }
    for (int round = 0; round < 12; ++round) {
      const Vec3d u = Normalized(Vec3d{unit(random), unit(random), unit(random)});
      const Vec3d v = Normalized(Cross(u, Vec3d{unit(random), unit(random), unit(random)}));
      EXPECT_NEAR(Area(CutTurned(path, u, v)), area, 1e-9 * area);
    }
  }
}

TEST(PolygonTouchingItself, HasNoSurfaceWhenItOnlyGoesOutAndBack) {
  std::mt19937_64 random = test::RandomEngine(44);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int round = 0; round < 200; ++round) {
    // A walk around a tree.
    std::vector<Point2> path = {{0, 0}};
    for (int i = 0; i < 1 + round; ++i) {
      const auto at = static_cast<std::ptrdiff_t>(random() % path.size());
      const Point2 corner = path[static_cast<std::size_t>(at)];
      path.insert(path.begin() + at + 1, {{unit(random), unit(random)}, corner});
    }
    const Vec3d u = {unit(random), unit(random), unit(random)};
    const Vec3d v = {unit(random), unit(random), unit(random)};
    EXPECT_EQ(Area(CutTurned(path, u, v)), 0);
  }
}

TEST(PolygonTouchingItself, IsCoveredLoopByLoopWhereItCrossesItselfAtACorner) {
  // Two triangles that meet in a corner or with a corner on an edge, in opposite directions.
  for (const auto& [path, area] : std::vector<std::pair<Path, std::int64_t>>{
           {{{0, 3}, {0, 0}, {0, -2}, {-2, 0}, {0, 0}, {8, 2}}, 24 + 4},
           {{{0, 0}, {1, 1}, {2, 2}, {2, 0}, {1, 1}, {0, 2}}, 4},
           {{{0, 0}, {4, 0}, {4, 4}, {2, 0}, {2, -3}}, 8 + 6}}) {
    for (std::size_t start = 0; start < path.size(); ++start) {
      Path turned = path;
      std::rotate(turned.begin(), turned.begin() + static_cast<std::ptrdiff_t>(start),
                  turned.end());
      std::int64_t sum = 0;
      for (const auto& [a, b, c] : Cut(turned).triangles) {
        sum += std::abs(DoubleArea(turned[a], turned[b], turned[c]));
      }
      EXPECT_EQ(sum, area) << Text(turned);
    }
  }
}

}  // namespace
}  // namespace kdray::core
