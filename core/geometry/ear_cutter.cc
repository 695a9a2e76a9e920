// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/ear_cutter.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "core/geometry/chord_depth.h"

namespace kdray::core {
namespace {

// Testing edges takes n^2 steps if long edges lie askew. After this many steps only corners are
// tested.
constexpr std::uint64_t kEdgeSteps = std::uint64_t{1} << 27;
constexpr std::uint64_t kEdgeStepsPerCorner = 20'000;

// From left to right, then upward: every step of a path goes forward or backward by this order.
bool Before(Point2 a, Point2 b) { return a.x < b.x || (a.x == b.x && a.y < b.y); }

// For two different points on one ray from q: whether p is the nearer one.
bool IsNearer(Point2 q, Point2 p, Point2 other) {
  return Before(q, other) ? Before(p, other) : Before(other, p);
}

// Whether the line through p and q has corners of the triangle on both sides.
bool HasCornersOnBothSides(const Triangle2& triangle, Point2 p, Point2 q) {
  bool left = false;
  bool right = false;
  for (const Point2 corner : triangle) {
    const int side = Orient2d(p, q, corner);
    left = left || side > 0;
    right = right || side < 0;
  }
  return left && right;
}

}  // namespace

EarCutter::Sides EarCutter::SidesOf(const Triangle2& triangle, Point2 p) {
  const auto [a, b, c] = triangle;
  return {Orient2d(a, b, p), Orient2d(b, c, p), Orient2d(c, a, p)};
}

Triangle2 EarCutter::TriangleAt(std::uint32_t i) const {
  return {ring_.point(ring_.previous(i)), ring_.point(i), ring_.point(ring_.next(i))};
}

void EarCutter::Begin(std::span<const Point2> path, bool force) {
  has_endless_parts_ = false;
  over_edges_ = force;
  edge_steps_end_ = meter_->spent() + kEdgeSteps + kEdgeStepsPerCorner * path.size();
  const auto n = static_cast<std::uint32_t>(path.size());
  left_ = n;
  ring_.Reset(path);
  corners_.assign(n, Corner{});
  boxes_.Clear();
  turning_back_.clear();
  for (IndexSet* set : {&untested_, &touched_, &straight_}) set->Reset(n);
  ranked_ = false;
  unranked_.clear();
  ranks_ = {};
  for (std::uint32_t i = 0; i < n && !meter_->Spend(20); ++i) Update(i);
}

// The order of the cuts: first corners at which the path turns back, because the comparison of
// coinciding parts relies on their absence; then ears; then ears with corners on their diagonal;
// then corners with a straight angle. Each cut keeps a weakly simple path weakly simple. One of
// them always exists: the simple paths near such a path have triangulations, so the path has one
// whose triangles turn left or have no area, and two of these are ears. Continuing one corner
// further after an ear gives rounder triangles than a fan around one corner.
EarCutter::Outcome EarCutter::Cut(std::span<const Point2> path, bool force,
                                  std::vector<Triangle>* triangles) {
  if (path.size() < 3) return Outcome::kDone;
  Begin(path, force);
  Outcome outcome = Outcome::kDone;
  std::uint32_t current = 0;
  const auto cut = [&](std::uint32_t i) {
    current = ring_.next(ring_.next(i));
    Remove(i, triangles);
  };
  while (left_ > 3 && !meter_->stopped()) {
    if (!turning_back_.empty()) {
      const std::uint32_t i = turning_back_.back();
      turning_back_.pop_back();
      if (!corners_[i].left || !TurnsBack(i)) continue;
      if (current == i) current = ring_.next(i);
      Remove(i, triangles);
    } else if (const auto untested = untested_.NextFrom(current)) {
      untested_.Erase(*untested);
      current = ring_.next(*untested);
      if (Test(*untested) == Verdict::kEar) cut(*untested);
    } else if (const auto touched = touched_.NextFrom(current)) {
      touched_.Erase(*touched);
      if (Test(*touched) != Verdict::kBlocked) cut(*touched);
    } else if (const auto straight = straight_.NextFrom(current)) {
      cut(*straight);
    } else if (force) {
      outcome = Outcome::kForced;
      cut(LeastHarmful());
    } else {
      return Outcome::kStuck;
    }
  }
  if (meter_->stopped()) return Outcome::kStopped;
  // Three corners are left; `current` is one of them.
  if (corners_[current].turn < 0) {
    if (!force) return Outcome::kStuck;
    outcome = Outcome::kForced;
  }
  triangles->push_back({ring_.previous(current), current, ring_.next(current)});
  return outcome;
}

bool EarCutter::TurnsBack(std::uint32_t i) const {
  const auto [a, b, c] = TriangleAt(i);
  return a == b || b == c || (corners_[i].turn == 0 && Before(a, b) != Before(b, c));
}

// Must be called when the neighbors of a corner have changed.
void EarCutter::Update(std::uint32_t i) {
  Corner& corner = corners_[i];
  const auto [a, b, c] = TriangleAt(i);
  corner.turn = static_cast<std::int8_t>(Orient2d(a, b, c));
  ++corner.version;
  Unwatch(i);
  untested_.Erase(i);
  touched_.Erase(i);
  straight_.Erase(i);
  if (TurnsBack(i)) {
    turning_back_.push_back(i);
  } else if (corner.turn > 0) {
    untested_.Insert(i);
  } else if (corner.turn == 0) {
    straight_.Insert(i);
  }
  if (ranked_) unranked_.push_back(i);
}

void EarCutter::Remove(std::uint32_t i, std::vector<Triangle>* triangles) {
  meter_->Spend(100);
  const std::uint32_t a = ring_.previous(i);
  const std::uint32_t c = ring_.next(i);
  triangles->push_back({a, i, c});
  ring_.Remove(i);
  corners_[i].left = false;
  --left_;
  boxes_.Remove(i, a);
  untested_.Erase(i);
  touched_.Erase(i);
  straight_.Erase(i);
  Unwatch(i);
  for (const std::uint32_t blocker : {a, i, c}) WakeWatchers(blocker);
  Update(a);
  Update(c);
}

void EarCutter::Rebuild() {
  std::vector<std::uint32_t> corners;
  corners.reserve(left_);
  for (std::uint32_t i = 0; i < corners_.size(); ++i) {
    if (corners_[i].left) corners.push_back(i);
  }
  boxes_.Build(std::move(corners),
               over_edges_ ? RingBoxes::Over::kEdges : RingBoxes::Over::kCorners);
}

// A left turn is an ear if no part of the path lies inside its triangle. If edges do not cross, a
// part inside has a corner in the closed triangle from which an edge enters the open triangle, or
// it follows both sides of the ear on the inner side. (A part that follows one side leaves it
// outwards, or by an edge into the open triangle.) If edges cross, the edges themselves are tested.
// The corner found is the blocker: the ear stays blocked until the blocker or one of its neighbors
// is cut.
EarCutter::Verdict EarCutter::Test(std::uint32_t i) {
  const bool was_over_edges = over_edges_;
  over_edges_ = over_edges_ && meter_->spent() < edge_steps_end_;
  if (boxes_.built_size() == 0 || left_ < boxes_.built_size() / 2 ||
      over_edges_ != was_over_edges) {
    Rebuild();
  }
  Unwatch(i);
  const Triangle2 triangle = TriangleAt(i);
  std::uint32_t blocker = kNone;
  std::uint32_t on_diagonal = kNone;
  boxes_.Visit(triangle, [&](std::uint32_t corner) {
    meter_->Spend(40);
    const Sides sides = SidesOf(triangle, ring_.point(corner));
    const bool is_in = sides.ab >= 0 && sides.bc >= 0 && sides.ca >= 0;
    if ((is_in && corner != i && LeadsInside(triangle, sides, i, corner)) ||
        (over_edges_ && EdgeMeets(triangle, sides, corner))) {
      blocker = corner;
      return true;
    }
    if (is_in && sides.ca == 0 && sides.ab > 0 && sides.bc > 0) on_diagonal = corner;
    return false;
  });
  if (blocker != kNone) {
    Watch(i, blocker);
    return Verdict::kBlocked;
  }
  if (on_diagonal != kNone) {
    Watch(i, on_diagonal);
    touched_.Insert(i);
    return Verdict::kTouched;
  }
  return Verdict::kEar;
}

// For a corner in the closed triangle of an ear.
bool EarCutter::LeadsInside(const Triangle2& triangle, const Sides& at, std::uint32_t ear,
                            std::uint32_t corner) {
  if (at.ab > 0 && at.bc > 0 && at.ca > 0) return true;
  for (const std::uint32_t neighbor : {ring_.previous(corner), ring_.next(corner)}) {
    const Sides to = SidesOf(triangle, ring_.point(neighbor));
    if ((at.ab > 0 || to.ab > 0) && (at.bc > 0 || to.bc > 0) && (at.ca > 0 || to.ca > 0)) {
      return true;
    }
  }
  return at.ab == 0 && at.bc == 0 && RunsInside(ear, corner);
}

// Whether the edge from a corner meets the open triangle: neither a side of the triangle nor the
// line of the edge separates the two.
bool EarCutter::EdgeMeets(const Triangle2& triangle, const Sides& at, std::uint32_t corner) const {
  const Point2 p = ring_.point(corner);
  const Point2 q = ring_.point(ring_.next(corner));
  const Sides to = SidesOf(triangle, q);
  return (at.ab > 0 || to.ab > 0) && (at.bc > 0 || to.bc > 0) && (at.ca > 0 || to.ca > 0) &&
         HasCornersOnBothSides(triangle, p, q);
}

// For a corner at the position of an ear: whether both its edges follow those of the ear, on the
// ear's inner side.
bool EarCutter::RunsInside(std::uint32_t ear, std::uint32_t other) {
  const auto [a, b, c] = TriangleAt(ear);
  const auto along_ab = [&, a = a, b = b, c = c](Point2 p) {
    return Orient2d(a, b, p) == 0 && Orient2d(b, c, p) > 0;
  };
  const auto along_bc = [&, a = a, b = b, c = c](Point2 p) {
    return Orient2d(b, c, p) == 0 && Orient2d(a, b, p) > 0;
  };
  const Point2 before = ring_.point(ring_.previous(other));
  const Point2 after = ring_.point(ring_.next(other));
  const bool same = along_ab(before) && along_bc(after);
  const bool opposite = along_ab(after) && along_bc(before);
  if (!same && !opposite) return false;
  // Seen from b, the inside lies to the right of the way to a and to the left of the way to c. One
  // comparison decides, unless the two parts turn back into each other at its end. Parts that never
  // separate belong to a path that is not weakly simple, for example one that winds many times;
  // following them for every pair would take long.
  if (has_endless_parts_) return false;
  if (const int side = Compare(ear, false, other, opposite); side != 0) return side < 0;
  const int side = Compare(ear, true, other, same);
  has_endless_parts_ = side == 0;
  return side > 0;
}

// Two ways through the ring, forward or backward, that leave one point in the same direction: +1
// when the other one leaves the first to the left, -1 to the right, 0 when they never separate.
int EarCutter::Compare(std::uint32_t from, bool forward, std::uint32_t other, bool other_forward) {
  const auto step = [&](std::uint32_t i, bool ahead) {
    return ahead ? ring_.next(i) : ring_.previous(i);
  };
  Point2 start = ring_.point(from);
  std::uint32_t i = step(from, forward);
  std::uint32_t j = step(other, other_forward);
  for (std::uint32_t steps = 0; steps < 2 * left_ && !meter_->Spend(40); ++steps) {
    const Point2 p = ring_.point(i);
    const Point2 q = ring_.point(j);
    if (p == q) {
      const Point2 after_p = ring_.point(step(i, forward));
      const Point2 after_q = ring_.point(step(j, other_forward));
      const int turn_p = Orient2d(start, p, after_p);
      const int turn_q = Orient2d(start, p, after_q);
      if (turn_p != turn_q) return turn_q > turn_p ? 1 : -1;
      if (turn_p != 0) {
        if (const int side = Orient2d(p, after_p, after_q); side != 0) return side;
      }
      i = step(i, forward);
      j = step(j, other_forward);
      start = p;
    } else if (IsNearer(start, q, p)) {
      j = step(j, other_forward);
      if (const int side = Orient2d(start, p, ring_.point(j)); side != 0) return side;
      start = q;
    } else {
      i = step(i, forward);
      if (const int side = Orient2d(start, q, ring_.point(i)); side != 0) return -side;
      start = p;
    }
  }
  return 0;
}

void EarCutter::Watch(std::uint32_t watcher, std::uint32_t blocker) {
  Corner& corner = corners_[watcher];
  corner.blocker = blocker;
  corner.previous_watcher = kNone;
  corner.next_watcher = corners_[blocker].first_watcher;
  if (corner.next_watcher != kNone) corners_[corner.next_watcher].previous_watcher = watcher;
  corners_[blocker].first_watcher = watcher;
}

void EarCutter::Unwatch(std::uint32_t watcher) {
  Corner& corner = corners_[watcher];
  if (corner.blocker == kNone) return;
  if (corner.previous_watcher == kNone) {
    corners_[corner.blocker].first_watcher = corner.next_watcher;
  } else {
    corners_[corner.previous_watcher].next_watcher = corner.next_watcher;
  }
  if (corner.next_watcher != kNone) {
    corners_[corner.next_watcher].previous_watcher = corner.previous_watcher;
  }
  corner.blocker = kNone;
}

void EarCutter::WakeWatchers(std::uint32_t blocker) {
  while (corners_[blocker].first_watcher != kNone) {
    const std::uint32_t watcher = corners_[blocker].first_watcher;
    Unwatch(watcher);
    touched_.Erase(watcher);
    untested_.Insert(watcher);
    meter_->Spend(20);
  }
}

// Ranks are kept from one call to the next. A rank that has become too high, because the edges that
// it counted are gone, only delays the cut of its corner. A rank that is too low is corrected when
// it comes first.
std::uint32_t EarCutter::LeastHarmful() {
  if (!ranked_) {
    ranked_ = true;
    unranked_.clear();
    for (std::uint32_t i = 0; i < corners_.size(); ++i) unranked_.push_back(i);
  }
  for (const std::uint32_t i : unranked_) {
    if (corners_[i].left) AddRank(i);
  }
  unranked_.clear();
  std::uint32_t best = kNone;
  while (best == kNone) {
    const auto [i, version] = ranks_.top().second;
    ranks_.pop();
    if (!corners_[i].left || corners_[i].version != version) continue;
    if (const double harm = Harm(i); ranks_.empty() || harm <= ranks_.top().first) {
      best = i;
    } else {
      ranks_.push({harm, {i, version}});
    }
  }
  return best;
}

void EarCutter::AddRank(std::uint32_t i) { ranks_.push({Harm(i), {i, corners_[i].version}}); }

// How far other edges reach into the triangle, at most its smallest height; for a right turn, whose
// triangle lies outside, the whole smallest height.
double EarCutter::Harm(std::uint32_t i) const {
  meter_->Spend(50);
  const Triangle2 triangle = TriangleAt(i);
  const double height = SmallestHeight(triangle);
  if (corners_[i].turn <= 0) return height;
  constexpr int kMostEdges = 64;  // with more edges an estimate is enough
  int edges = 0;
  double harm = 0;
  boxes_.Visit(triangle, [&](std::uint32_t edge) {
    meter_->Spend(100);
    const Point2 p = ring_.point(edge);
    harm = std::max(harm, ChordDepth(triangle, p, ring_.point(ring_.next(edge))));
    if (!over_edges_) {
      harm = std::max(harm, ChordDepth(triangle, p, ring_.point(ring_.previous(edge))));
    }
    return harm >= height || ++edges == kMostEdges;
  });
  return std::min(harm, height);
}

}  // namespace kdray::core
