// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/ear_cutter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/allocation_count.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

using Path = std::vector<Point2>;

double DoubleArea(Point2 a, Point2 b, Point2 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

double DoubleArea(const Path& path) {
  double sum = 0;
  for (std::size_t i = 2; i < path.size(); ++i) sum += DoubleArea(path[0], path[i - 1], path[i]);
  return sum;
}

struct CutPath {
  EarCutter::Outcome outcome = EarCutter::Outcome::kStuck;
  std::vector<EarCutter::Triangle> triangles;
  std::uint64_t steps = 0;
  double area = 0;  // doubled sum of the triangles' areas
};

CutPath Cut(const Path& path, bool force = false) {
  CutMeter meter({});
  meter.Allow(std::uint64_t{1} << 40);
  EarCutter cutter(&meter);
  CutPath cut;
  cut.outcome = cutter.Cut(path, force, &cut.triangles);
  cut.steps = meter.spent();
  for (const auto& [a, b, c] : cut.triangles) {
    cut.area += std::fabs(DoubleArea(path[a], path[b], path[c]));
  }
  return cut;
}

Path Polar(int n, const std::function<double(int)>& radius) {
  Path path;
  for (int i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n;
    const double r = radius(i);
    path.push_back({r * std::cos(angle), r * std::sin(angle)});
  }
  return path;
}

Path Rotated(Path path, double angle) {
  for (Point2& p : path) {
    p = {p.x * std::cos(angle) - p.y * std::sin(angle),
         p.x * std::sin(angle) + p.y * std::cos(angle)};
  }
  return path;
}

Path Comb(int n) {
  Path path = {{0, -1}, {static_cast<double>(n), -1}};
  for (int i = n - 3; i >= 0; --i)
    path.push_back({static_cast<double>(i), i % 2 == 0 ? 1000.0 : 0.0});
  return path;
}

// A corridor of width 1 between right angles that winds inward.
Path Spiral(int n) {
  Path path;
  const int corners = n / 2;
  const auto corner = [&](int i, double inset) {
    const double r = corners - 2 * (i / 4) - inset;
    const double next = corners - 2 * ((i + 3) / 4) - inset;
    return i % 4 == 0   ? Point2{-next, -r}
           : i % 4 == 1 ? Point2{r, -r}
           : i % 4 == 2 ? Point2{r, r}
                        : Point2{-r, r};
  };
  for (int i = 0; i < corners; ++i) path.push_back(corner(i, 0));
  for (int i = corners - 1; i >= 0; --i) path.push_back(corner(i, 1));
  return path;
}

// A square with corners along its sides, and one of them moved inward.
Path ManyOnStraightSides(int n) {
  Path path;
  const int side = n / 4;
  for (int i = 0; i < side; ++i) path.push_back({static_cast<double>(i), 0});
  for (int i = 0; i < side; ++i)
    path.push_back({static_cast<double>(side), static_cast<double>(i)});
  for (int i = side; i > 0; --i)
    path.push_back({static_cast<double>(i), static_cast<double>(side)});
  for (int i = side; i > 0; --i) path.push_back({0, static_cast<double>(i)});
  path[0] = {1.5, 5};
  return path;
}

// Wedges one in another, open at one end.
Path Chevrons(int n) {
  Path path;
  for (int i = 0; i < n / 4; ++i) {
    const double y = 4.0 * i;
    path.insert(path.end(), {{-1000, y + 1000}, {0, y}, {1000, y + 1000}, {0, y + 1}});
  }
  path.insert(path.end(), {{-1001, 4.0 * (n / 4) + 1000}, {-1001, 0}});
  std::reverse(path.begin(), path.end());
  if (DoubleArea(path) < 0) std::reverse(path.begin(), path.end());
  return path;
}

// A square with rows of holes, each row hanging on one line from the left side.
Path HolesInRows(int n) {
  const int rows = std::max(1, static_cast<int>(std::sqrt(n / 6.0)));
  const double size = 4 * rows + 2;
  Path path = {{0, 0}, {size, 0}, {size, size}, {0, size}};
  for (int row = rows - 1; row >= 0; --row) {
    const double y = 4 * row + 2;
    path.push_back({0, y});
    for (int i = 0; i < rows; ++i) {
      const double x = 4 * i + 2;
      path.insert(path.end(), {{x, y}, {x + 1, y + 1}, {x + 2, y}});
    }
    for (int i = rows - 1; i >= 0; --i) {
      const double x = 4 * i + 2;
      path.insert(path.end(), {{x + 1, y - 1}, {x, y}});
      if (i > 0) path.push_back({x - 2, y});
    }
    path.push_back({0, y});
  }
  return path;
}

// Squares in a row that meet in their corners, gone along below and back above.
Path Beads(int n) {
  Path path;
  const int beads = n / 6;
  for (int i = 0; i < beads; ++i) {
    const double x = 3 * i;
    path.insert(path.end(), {{x, 0}, {x + 1, -1}, {x + 2, -1}});
  }
  for (int i = beads; i > 0; --i) {
    const double x = 3 * i;
    path.insert(path.end(), {{x, 0}, {x - 1, 1}, {x - 2, 1}});
  }
  return path;
}

// A square with lines that go out from one point and come back.
Path Hub(int n) {
  Path path = {{-9, -9}, {9, -9}, {9, 9}};
  for (const Point2 tip : Polar(n / 2, [](int i) { return 1 + i % 3; })) {
    path.insert(path.end(), {{0, 0}, tip});
  }
  path.insert(path.end(), {{0, 0}, {9, 9}, {-9, 9}});
  return path;
}

TEST(EarCutter, TakesStepsInProportionToCornersUpToALogarithm) {
  std::mt19937_64 random = test::RandomEngine(30);
  std::uniform_real_distribution<double> unit(0, 1);
  const std::vector<std::pair<std::string, std::function<Path(int)>>> shapes = {
      {"flat star", [](int n) { return Polar(n, [](int i) { return i % 2 == 0 ? 1 : 0.9999; }); }},
      {"star", [](int n) { return Polar(n, [](int i) { return i % 2 == 0 ? 1 : 0.3; }); }},
      {"noise", [&](int n) { return Polar(n, [&](int) { return 1 + 0.3 * unit(random); }); }},
      {"comb", Comb},
      {"comb askew", [](int n) { return Rotated(Comb(n), 0.7); }},
      {"spiral", Spiral},
      {"spiral askew", [](int n) { return Rotated(Spiral(n), 0.7); }},
      {"straight sides", ManyOnStraightSides},
      {"chevrons", Chevrons},
      {"holes", HolesInRows},
      {"holes askew", [](int n) { return Rotated(HolesInRows(n), 0.3); }},
      {"beads", Beads},
      {"hub", Hub},
  };
  for (const auto& [name, shape] : shapes) {
    SCOPED_TRACE(name);
    const Path small = shape(2048);
    const Path large = shape(8 * 2048);
    const CutPath few = Cut(small);
    const CutPath many = Cut(large);
    for (const auto& [path, cut] : {std::pair(&small, &few), std::pair(&large, &many)}) {
      EXPECT_EQ(cut->outcome, EarCutter::Outcome::kDone);
      EXPECT_EQ(cut->triangles.size(), path->size() - 2);
      EXPECT_NEAR(cut->area, DoubleArea(*path), 1e-9 * cut->area);
    }
    // n log n gives 10.2, n^2 gives 64.
    EXPECT_LT(static_cast<double>(many.steps), 16.0 * static_cast<double>(few.steps));
    EXPECT_LT(many.steps / large.size(), 5000u);
  }
}

TEST(EarCutter, TakesNoMoreMemoryThanItSays) {
  for (const bool force : {false, true}) {
    std::mt19937_64 random = test::RandomEngine(31);
    std::uniform_real_distribution<double> unit(0, 1);
    Path path;  // crosses itself
    for (int i = 0; i < 5000; ++i) path.push_back({unit(random), unit(random)});
    if (!force) path = Polar(5000, [](int i) { return i % 2 == 0 ? 1 : 0.9999; });
    std::vector<EarCutter::Triangle> triangles;
    triangles.reserve(path.size());
    CutMeter meter({});
    meter.Allow(std::uint64_t{1} << 40);
    const test::AllocationPeak memory;
    EarCutter cutter(&meter);
    cutter.Cut(path, force, &triangles);
    EXPECT_EQ(triangles.size(), path.size() - 2);
    EXPECT_LE(memory.bytes(), EarCutter::kScratchBytesPerCorner * path.size());
  }
}

TEST(EarCutter, LeavesOutThePartsThatTheInsideOfAPathTouches) {
  // A corner on an edge, two loops in a point, and a line out and back.
  for (const Path& path : {Path{{0, 0}, {6, 0}, {6, 4}, {3, 0}, {0, 4}},
                           Path{{0, 3}, {0, 0}, {-2, 0}, {0, -2}, {0, 0}, {8, 2}},
                           Path{{0, 0}, {4, 0}, {6, 1}, {4, 0}, {0, 4}}}) {
    const CutPath cut = Cut(path);
    EXPECT_EQ(cut.outcome, EarCutter::Outcome::kDone);
    EXPECT_EQ(cut.area, DoubleArea(path));
  }
}

TEST(EarCutter, IsStuckInAPathThatCrossesItselfUnlessForced) {
  const Path bow_tie = {{0, 0}, {4, 4}, {4, 0}, {0, 5}};
  EXPECT_EQ(Cut(bow_tie).outcome, EarCutter::Outcome::kStuck);
  const CutPath forced = Cut(bow_tie, true);
  EXPECT_EQ(forced.outcome, EarCutter::Outcome::kForced);
  EXPECT_EQ(forced.triangles.size(), 2u);
  const Path clockwise = {{0, 0}, {0, 4}, {1, 1}, {4, 0}};
  EXPECT_EQ(Cut(clockwise).outcome, EarCutter::Outcome::kStuck);
}

TEST(EarCutter, LosesOnlyWhatRoundingMovedWhenForced) {
  // A long comb whose gaps reach down to its base line, some a little across it.
  std::mt19937_64 random = test::RandomEngine(32);
  for (const double angle : {0.3, 1.1, 2.5}) {
    Path path = {{0, 0}, {600, 0}};
    for (int i = 599; i >= 0; --i) {
      path.push_back({i + 0.5, 100.0 + static_cast<double>(random() % 7)});
      if (i > 0) path.push_back({static_cast<double>(i), 0});
    }
    const double area = DoubleArea(path);
    path = Rotated(path, angle);
    ASSERT_EQ(Cut(path).outcome, EarCutter::Outcome::kStuck);
    const CutPath cut = Cut(path, true);
    EXPECT_EQ(cut.triangles.size(), path.size() - 2);
    EXPECT_NEAR(cut.area, area, 1e-9 * area);
  }
}

TEST(EarCutter, EndsWithPathsThatCrossThemselvesEverywhere) {
  std::mt19937_64 random = test::RandomEngine(33);
  for (const int size : {3, 10, 1000000}) {
    std::uniform_int_distribution<int> grid(0, size);
    for (const int n : {5, 50, 500, 5000}) {
      Path path;
      for (int i = 0; i < n; ++i) {
        path.push_back({static_cast<double>(grid(random)), static_cast<double>(grid(random))});
      }
      const CutPath cut = Cut(path, true);
      EXPECT_EQ(cut.triangles.size(), path.size() - 2);
      EXPECT_EQ(Cut(path, true).triangles, cut.triangles);
    }
  }
}

TEST(EarCutter, TakesFewStepsForAPathThatGoesAroundManyTimes) {
  Path path;
  for (int i = 0; i < 250; ++i) path.insert(path.end(), {{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  const CutPath cut = Cut(path);
  EXPECT_EQ(cut.triangles.size(), path.size() - 2);
  EXPECT_EQ(cut.area, 250 * 2);
  EXPECT_LT(cut.steps, 30000 * path.size());
}

TEST(EarCutter, StopsWhenItsMeterSaysSo) {
  const Path path = Polar(5000, [](int i) { return i % 2 == 0 ? 1 : 0.9; });
  CutMeter meter({});
  meter.Allow(1000000);
  EarCutter cutter(&meter);
  std::vector<EarCutter::Triangle> triangles;
  EXPECT_EQ(cutter.Cut(path, false, &triangles), EarCutter::Outcome::kStopped);
  EXPECT_TRUE(meter.exhausted());
  EXPECT_LT(meter.spent(), 1100000u);
}

}  // namespace
}  // namespace kdray::core
