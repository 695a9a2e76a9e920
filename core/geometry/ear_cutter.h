// SPDX-License-Identifier: Apache-2.0
// Triangulates a closed path, which may touch itself, by ear clipping.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <queue>
#include <span>
#include <utility>
#include <vector>

#include "core/geometry/cut_meter.h"
#include "core/geometry/index_set.h"
#include "core/geometry/predicates.h"
#include "core/geometry/ring.h"
#include "core/geometry/ring_boxes.h"

namespace kdray::core {

/// Ear clipping (G. H. Meisters, "Polygons Have Ears", American Mathematical Monthly 82, 1975). The
/// paths may be weakly simple: they may touch themselves, but an arbitrarily small move of the
/// corners makes them simple (H.-C. Chang, J. Erickson, C. Xu, "Detecting Weakly Simple Polygons",
/// SODA 2015). Every decision is exact. A tree of boxes finds what may lie in an ear. Not safe from
/// two threads at once.
class EarCutter {
 public:
  /// Corners of the path, counted from 0.
  using Triangle = std::array<std::uint32_t, 3>;
  enum class Outcome {
    kDone,    ///< n - 2 triangles, none of which turns clockwise
    kForced,  ///< n - 2 triangles, some of which may overlap or turn clockwise
    kStuck,   ///< not done: the path is not weakly simple or not counterclockwise
    kStopped  ///< not done: the meter has stopped
  };

  /// The meter must outlive this object. Some 1,000 to 3,000 steps a corner are usual.
  explicit EarCutter(CutMeter* meter) : meter_(meter), boxes_(&ring_, meter) {}

  /// Appends n - 2 triangles of a path of n corners that goes counterclockwise around its inside.
  /// They use the path's corners in its order, so their common boundary is the path. If no triangle
  /// turns clockwise, each point off the path lies in k triangles, where k is the path's winding
  /// number there: 1 inside and 0 outside for a weakly simple path. Where the path has a straight
  /// angle, turns back, or touches itself, triangles may have no area.
  ///
  /// If no ear is left, the path is not weakly simple. Without `force` the outcome is then kStuck.
  /// With `force`, the corner is cut whose triangle other edges enter least far; so a crossing
  /// caused by rounding costs an area of its own size. If the outcome is kStuck or kStopped, some
  /// triangles may have been appended. O(n log n) for polygons as in real files.
  Outcome Cut(std::span<const Point2> path, bool force, std::vector<Triangle>* triangles);

  /// Upper bound of Cut()'s memory for each corner of the path.
  static constexpr std::uint64_t kScratchBytesPerCorner = 160;

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  struct Corner {
    std::uint32_t blocker = kNone;        // the corner on whose watch list this one is
    std::uint32_t first_watcher = kNone;  // of the corners that this one blocks
    std::uint32_t previous_watcher = kNone;
    std::uint32_t next_watcher = kNone;
    std::uint16_t version = 0;  // how often its neighbors have changed
    std::int8_t turn = 0;       // Orient2d(previous, this, next)
    bool left = true;           // not cut yet
  };
  // The sides of a triangle on which a point lies: positive is inside, for each of the three edges.
  struct Sides {
    int ab, bc, ca;
  };
  enum class Verdict { kEar, kTouched, kBlocked };
  using Rank = std::pair<double, std::pair<std::uint32_t, std::uint16_t>>;  // harm; corner, version

  static Sides SidesOf(const Triangle2& triangle, Point2 p);
  Triangle2 TriangleAt(std::uint32_t i) const;
  void Begin(std::span<const Point2> path, bool force);
  bool TurnsBack(std::uint32_t i) const;
  void Update(std::uint32_t i);
  void Remove(std::uint32_t i, std::vector<Triangle>* triangles);
  void Rebuild();

  Verdict Test(std::uint32_t i);
  bool LeadsInside(const Triangle2& triangle, const Sides& at, std::uint32_t ear,
                   std::uint32_t corner);
  bool EdgeMeets(const Triangle2& triangle, const Sides& at, std::uint32_t corner) const;
  bool RunsInside(std::uint32_t ear, std::uint32_t other);
  int Compare(std::uint32_t from, bool forward, std::uint32_t other, bool other_forward);
  void Watch(std::uint32_t watcher, std::uint32_t blocker);
  void Unwatch(std::uint32_t watcher);
  void WakeWatchers(std::uint32_t blocker);

  std::uint32_t LeastHarmful();
  void AddRank(std::uint32_t i);
  double Harm(std::uint32_t i) const;

  CutMeter* meter_;
  Ring ring_;
  RingBoxes boxes_;
  std::vector<Corner> corners_;
  std::uint32_t left_ = 0;
  std::vector<std::uint32_t> turning_back_;  // corners to be cut first
  IndexSet untested_;                        // left turns whose ear is to be tested
  IndexSet touched_;                         // left turns with a corner on the diagonal only
  IndexSet straight_;
  bool has_endless_parts_ = false;       // whether two parts were found that coincide without end
  bool over_edges_ = false;              // whether edges are tested, not only corners
  std::uint64_t edge_steps_end_ = 0;     // when that ends
  bool ranked_ = false;                  // whether ranks_ was filled
  std::vector<std::uint32_t> unranked_;  // corners to be ranked again
  std::priority_queue<Rank, std::vector<Rank>, std::greater<>> ranks_;
};

}  // namespace kdray::core
