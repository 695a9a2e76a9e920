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

#include "core/geometry/ear_cutter.h"
#include "core/io/polygon.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

// A corner on a grid.
struct Place {
  std::int64_t x = 0;
  std::int64_t y = 0;
  friend bool operator==(const Place&, const Place&) = default;
};
using Path = std::vector<Place>;

std::int64_t DoubleArea(Place a, Place b, Place c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

std::int64_t DoubleArea(const Path& path) {
  std::int64_t sum = 0;
  for (std::size_t i = 2; i < path.size(); ++i) sum += DoubleArea(path[0], path[i - 1], path[i]);
  return sum;
}

int Side(Place a, Place b, Place c) {
  const std::int64_t area = DoubleArea(a, b, c);
  return area > 0 ? 1 : area < 0 ? -1 : 0;
}

bool Cross(Place a, Place b, Place c, Place d) {
  return Side(a, b, c) * Side(a, b, d) < 0 && Side(c, d, a) * Side(c, d, b) < 0;
}

bool IsOn(Place p, Place a, Place b) {
  return Side(a, b, p) == 0 && std::min(a.x, b.x) <= p.x && p.x <= std::max(a.x, b.x) &&
         std::min(a.y, b.y) <= p.y && p.y <= std::max(a.y, b.y);
}

Place Next(const Path& path, std::size_t i) { return path[i + 1 == path.size() ? 0 : i + 1]; }

bool CrossesItself(const Path& path) {
  for (std::size_t i = 0; i < path.size(); ++i) {
    for (std::size_t j = i + 2; j < path.size(); ++j) {
      if (Cross(path[i], Next(path, i), path[j], Next(path, j))) return true;
    }
  }
  return false;
}

// How often the path goes counterclockwise around a point that lies on none of its edges.
int Winding(const Path& path, double x, double y) {
  int winding = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Place a = path[i];
    const Place b = Next(path, i);
    const auto ax = static_cast<double>(a.x);
    const auto ay = static_cast<double>(a.y);
    const auto bx = static_cast<double>(b.x);
    const auto by = static_cast<double>(b.y);
    if ((ay <= y) == (by <= y)) continue;
    const double side = (bx - ax) * (y - ay) - (by - ay) * (x - ax);
    if (ay <= y && side > 0) ++winding;
    if (ay > y && side < 0) --winding;
  }
  return winding;
}

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

std::vector<Vec3d> InPlane(const Path& path, int plane) {
  std::vector<Vec3d> corners;
  for (const Place p : path) {
    const auto x = static_cast<double>(p.x);
    const auto y = static_cast<double>(p.y);
    corners.push_back(plane == 0   ? Vec3d{x, y, 7}
                      : plane == 1 ? Vec3d{7, x, y}
                      : plane == 2 ? Vec3d{y, 7, x}
                                   : Vec3d{x, y, 2 * x - 3 * y + 5});
  }
  return corners;
}

MeshData Cut(const Path& path, int plane = 0) {
  MeshData data;
  data.vertices = InPlane(path, plane);
  std::vector<std::uint32_t> corners(path.size());
  std::iota(corners.begin(), corners.end(), 0u);
  EXPECT_TRUE(PolygonCutter(&data, {}).Add(corners).ok());
  return data;
}

int Covers(const Path& path, const MeshData& data, double x, double y) {
  int count = 0;
  for (const auto& [a, b, c] : data.triangles) {
    if (Winding({path[a], path[b], path[c]}, x, y) != 0) ++count;
  }
  return count;
}

std::string Text(const Path& path) {
  std::string text;
  for (const Place p : path) text += " (" + std::to_string(p.x) + ", " + std::to_string(p.y) + ")";
  return text;
}

// The oracle for a path that does not cross itself: n - 2 triangles, none turns against the path,
// and their areas are together that of the path. With the boundary kept (below), that is enough.
void ExpectCoversOnce(const Path& path, int plane = 0) {
  const MeshData data = Cut(path, plane);
  ASSERT_EQ(data.triangles.size(), path.size() - 2);
  const std::int64_t area = DoubleArea(path);
  std::int64_t sum = 0;
  for (const auto& [a, b, c] : data.triangles) {
    const std::int64_t part = DoubleArea(path[a], path[b], path[c]);
    ASSERT_GE(area > 0 ? part : -part, 0) << a << ' ' << b << ' ' << c << " of" << Text(path);
    sum += part;
  }
  ASSERT_EQ(sum, area) << Text(path);
}

// Ears alone are enough: what is made for paths that cross themselves plays no part in it.
void ExpectEarsSuffice(Path path) {
  if (DoubleArea(path) < 0) std::reverse(path.begin(), path.end());
  std::vector<Point2> points;
  for (const Place p : path) points.push_back({static_cast<double>(p.x), static_cast<double>(p.y)});
  CutMeter meter({});
  meter.Allow(std::uint64_t{1} << 40);
  std::vector<EarCutter::Triangle> triangles;
  EXPECT_EQ(EarCutter(&meter).Cut(points, false, &triangles), EarCutter::Outcome::kDone)
      << Text(path);
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
