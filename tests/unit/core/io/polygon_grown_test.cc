// SPDX-License-Identifier: Apache-2.0
// Polygons that were grown until they touch themselves: what the triangles cover, against exact
// areas.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/seed.h"
#include "tests/unit/core/io/polygon_paths.h"

namespace kdray::core {
namespace {

// Grows a path by what makes it touch itself; all coordinates stay even, so that the middle of an
// edge is a place too.
class Growing {
 public:
  explicit Growing(std::mt19937_64* random) : random_(*random) {
    // A star around the origin, counterclockwise.
    const int n = 3 + Random(10);
    std::vector<double> angles;
    for (int i = 0; i < n; ++i) angles.push_back(2 * M_PI * (i + 0.1 * Random(8)) / n);
    for (const double angle : angles) {
      const double radius = 300 + Random(700);
      path_.push_back(
          {2 * std::llround(radius * std::cos(angle)), 2 * std::llround(radius * std::sin(angle))});
    }
  }

  const Path& path() const { return path_; }

  void Grow() {
    switch (Random(7)) {
      case 0:  // a corner twice
        return Insert(Random(size()), {});
      case 1:  // a line out and back
        return Attach(Random(size()), {Anywhere()});
      case 2:  // a line to the middle of an edge
        return Attach(Random(size()), {Middle(Random(size()))});
      case 3:  // a line to another corner
        return Attach(Random(size()), {path_[static_cast<std::size_t>(Random(size()))]});
      case 4: {  // a straight angle
        const int i = Random(size());
        const Place middle = Middle(i);
        if (middle.x % 2 == 0 && middle.y % 2 == 0) {
          path_.insert(path_.begin() + i + 1, middle);
        }
        return;
      }
      case 5: {  // a loop from a corner: around a hole, or outside
        const Place a = Anywhere();
        return Attach(Random(size()), {a, Near(a)});
      }
      default: {  // a hole at the end of a line
        const Place a = Anywhere();
        return Attach(Random(size()), {a, Near(a), Near(a), a});
      }
    }
  }

 private:
  int Random(int n) { return static_cast<int>(random_() % static_cast<std::uint64_t>(n)); }
  int size() const { return static_cast<int>(path_.size()); }
  Place Anywhere() { return {2 * (Random(1600) - 800), 2 * (Random(1600) - 800)}; }
  Place Near(Place p) { return {p.x + 2 * (Random(100) - 50), p.y + 2 * (Random(100) - 50)}; }
  Place Middle(int i) const {
    const Place a = path_[static_cast<std::size_t>(i)];
    const Place b = Next(path_, static_cast<std::size_t>(i));
    return {(a.x + b.x) / 2, (a.y + b.y) / 2};
  }

  void Insert(int i, const Path& chain) {
    Path there = chain;
    there.push_back(path_[static_cast<std::size_t>(i)]);
    path_.insert(path_.begin() + i + 1, there.begin(), there.end());
  }

  // From corner i along the chain and back to the corner, when the chain's inner corners and edges
  // meet nothing but that corner, except for the end of a line; and when the winding numbers stay
  // what they may be.
  void Attach(int i, const Path& chain) {
    const Place corner = path_[static_cast<std::size_t>(i)];
    Path whole = {corner};
    whole.insert(whole.end(), chain.begin(), chain.end());
    const bool is_line = chain.size() == 1;
    for (std::size_t k = 0; k < chain.size(); ++k) {
      if (chain[k].x % 2 != 0 || chain[k].y % 2 != 0 || chain[k] == corner) return;
      for (std::size_t j = 0; j < path_.size(); ++j) {
        if (!is_line && IsOn(chain[k], path_[j], Next(path_, j))) return;
        // Corners that the new edges pass; the corner itself may be there several times.
        for (std::size_t m = 0; m < whole.size(); ++m) {
          const Place end = Next(whole, m);
          if (Cross(whole[m], end, path_[j], Next(path_, j))) return;
          const bool is_end = path_[j] == whole[m] || path_[j] == end;
          if (IsOn(path_[j], whole[m], end) && !(is_end && (is_line || path_[j] == corner))) return;
          if (is_line && IsOn(chain[0], path_[j], Next(path_, j))) continue;
        }
      }
    }
    // Corner i on an edge, or several times: only lines whose place is certain.
    Path longer = path_;
    whole.erase(whole.begin());
    whole.push_back(corner);
    longer.insert(longer.begin() + i + 1, whole.begin(), whole.end());
    if (IsProper(longer, i, static_cast<int>(chain.size()))) path_ = longer;
  }

  // Whether the edges of the new chain leave corner i in the angle of its first visit, seen from
  // the others too: no other visit of that place may lie between.
  bool IsProper(const Path& path, int i, int chain) const {
    const Place corner = path[static_cast<std::size_t>(i)];
    for (std::size_t j = 0; j < path_.size(); ++j) {
      if (static_cast<int>(j) == i) continue;
      if (IsOn(corner, path_[j], Next(path_, j)) && Next(path_, j) != corner) return false;
    }
    if (chain == 1) return true;
    // Loops: a point inside must get the winding 0 or 1.
    Path loop(path.begin() + i, path.begin() + i + chain + 1);
    if (chain == 4) loop.erase(loop.begin());
    Place a = loop[0];
    Place b = loop[1];
    Place c = loop[2];
    if (Side(a, b, c) == 0) return false;
    const double x = static_cast<double>(a.x + b.x + c.x) / 3 + 1e-4;
    const double y = static_cast<double>(a.y + b.y + c.y) / 3 + 1e-4;
    const int winding = Winding(path, x, y);
    const int before = Winding(path_, x, y);
    return before != winding && (winding == 0 || winding == 1);
  }

  std::mt19937_64& random_;
  Path path_;
};

TEST(PolygonTouchingItself, IsCoveredOnceForGrownPathsFromEveryStartInEveryPlaneAndDirection) {
  std::mt19937_64 random = test::RandomEngine(41);
  std::size_t corners = 0;
  for (int round = 0; round < 1500; ++round) {
    Growing growing(&random);
    for (int i = 0; i < 60; ++i) growing.Grow();
    Path path = growing.path();
    if (CrossesItself(path)) continue;
    corners += path.size();
    std::rotate(path.begin(), path.begin() + static_cast<int>(random() % path.size()), path.end());
    if (round % 2 == 1) std::reverse(path.begin(), path.end());
    ExpectCoversOnce(path, round % 4);
    ExpectEarsSuffice(path);
    if (HasFailure()) return;
  }
  EXPECT_GT(corners, 1500u * 20);
}

// A disk that was put together from triangles of a grid, each taken once and glued to one before it
// by one edge. Where others of its edges meet, the disk is not glued: its outline runs along them
// there and back, meets itself in points, and goes around holes. Its area is known.
class GluedTriangles {
 public:
  GluedTriangles(int size, bool is_regular, std::mt19937_64* random)
      : random_(*random), size_(size), is_used_(static_cast<std::size_t>(2 * size * size)) {
    for (int y = 0; y <= size; ++y) {
      for (int x = 0; x <= size; ++x) {
        const int jitter_x = is_regular ? 0 : Random(5) - 2;
        const int jitter_y = is_regular ? 0 : Random(5) - 2;
        places_.push_back({10 * x + jitter_x, 10 * y + jitter_y});
      }
    }
    const int first = Random(2 * size * size);
    is_used_[static_cast<std::size_t>(first)] = true;
    const std::array<int, 3> corners = CornersOf(first);
    outline_.assign(corners.begin(), corners.end());
  }

  void Glue() {
    const int i = Random(static_cast<int>(outline_.size()));
    const int from = outline_[static_cast<std::size_t>(i)];
    const int to = outline_[static_cast<std::size_t>(i + 1) % outline_.size()];
    for (int triangle = 0; triangle < 2 * size_ * size_; ++triangle) {
      if (is_used_[static_cast<std::size_t>(triangle)]) continue;
      const std::array<int, 3> corners = CornersOf(triangle);
      for (std::size_t k = 0; k < 3; ++k) {
        if (corners[k] != to || corners[(k + 1) % 3] != from) continue;
        is_used_[static_cast<std::size_t>(triangle)] = true;
        outline_.insert(outline_.begin() + i + 1, corners[(k + 2) % 3]);
        return;
      }
    }
  }

  // A line back along the edge before or after a corner, and out again.
  void Fold() {
    const int n = static_cast<int>(outline_.size());
    const int i = Random(n);
    const int other = (i + (Random(2) == 0 ? 1 : n - 1)) % n;
    const std::array<int, 2> line = {outline_[static_cast<std::size_t>(other)],
                                     outline_[static_cast<std::size_t>(i)]};
    outline_.insert(outline_.begin() + i + 1, line.begin(), line.end());
  }

  Path path() const {
    Path path;
    for (const int corner : outline_) path.push_back(places_[static_cast<std::size_t>(corner)]);
    return path;
  }

  // Doubled, of the triangles that were glued.
  std::int64_t area() const {
    std::int64_t sum = 0;
    for (int triangle = 0; triangle < 2 * size_ * size_; ++triangle) {
      if (!is_used_[static_cast<std::size_t>(triangle)]) continue;
      const auto [a, b, c] = CornersOf(triangle);
      sum += DoubleArea(places_[static_cast<std::size_t>(a)], places_[static_cast<std::size_t>(b)],
                        places_[static_cast<std::size_t>(c)]);
    }
    return sum;
  }

 private:
  int Random(int n) { return static_cast<int>(random_() % static_cast<std::uint64_t>(n)); }

  std::array<int, 3> CornersOf(int triangle) const {
    const int cell = triangle / 2;
    const int a = cell / size_ * (size_ + 1) + cell % size_;
    const int c = a + size_ + 2;
    return triangle % 2 == 0 ? std::array<int, 3>{a, a + 1, c}
                             : std::array<int, 3>{a, c, a + size_ + 1};
  }

  std::mt19937_64& random_;
  int size_;
  std::vector<bool> is_used_;
  std::vector<Place> places_;
  std::vector<int> outline_;
};

TEST(PolygonTouchingItself, IsCoveredOnceForDisksGluedFromTheTrianglesOfAGrid) {
  std::mt19937_64 random = test::RandomEngine(42);
  std::size_t corners = 0;
  for (int round = 0; round < 3000; ++round) {
    const int size = 2 + static_cast<int>(random() % (round % 50 == 0 ? 15 : 5));
    GluedTriangles disk(size, round % 3 == 0, &random);
    for (int i = 0; i < 40 * size; ++i) disk.Glue();
    for (int i = 0; i < round % 9; ++i) disk.Fold();
    Path path = disk.path();
    ASSERT_EQ(DoubleArea(path), disk.area());
    corners += path.size();
    std::rotate(path.begin(), path.begin() + static_cast<int>(random() % path.size()), path.end());
    if (round % 2 == 1) std::reverse(path.begin(), path.end());
    ExpectCoversOnce(path, round % 4);
    ExpectEarsSuffice(path);
    if (HasFailure()) return;
  }
  EXPECT_GT(corners, 3000u * 10);
}

}  // namespace
}  // namespace kdray::core
