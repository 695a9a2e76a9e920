// SPDX-License-Identifier: Apache-2.0
// Candidates for cuts: each finder against counting anew for every plane.
#include "core/accel/kdtree/split.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include "core/accel/kdtree/binned_split.h"
#include "core/accel/kdtree/centroid_split.h"
#include "core/accel/kdtree/event_sort.h"
#include "core/accel/kdtree/partition.h"
#include "core/accel/kdtree/sweep_split.h"
#include "core/accel/primitive_ref.h"
#include "core/base/parallel.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::test {
namespace {

using core::BinnedCounts;
using core::Bounds3f;
using core::PrimitiveRef;
using core::SahCost;
using core::Side;
using core::SideCounts;
using core::SplitCandidate;
using core::SplitEvent;
using core::SplitSearch;
using core::TriangleMesh;
using Kind = SplitEvent::Kind;

const Bounds3f kUnitCell{{-1, -1, -1}, {1, 1, 1}};

// Intervals on a coarse grid, so that ends coincide and some are flat.
std::vector<PrimitiveRef> GridReferences(std::mt19937_64& engine, std::size_t count) {
  std::vector<PrimitiveRef> references;
  for (std::size_t i = 0; i < count; ++i) {
    Bounds3f bounds;
    for (int axis = 0; axis < 3; ++axis) {
      const float low = static_cast<float>(engine() % 16) / 8 - 1;
      const float size = static_cast<float>(engine() % 4) / 8;
      bounds.min[axis] = low;
      bounds.max[axis] = std::min(low + size, 1.0f);
    }
    references.push_back({bounds, static_cast<core::PrimitiveId>(i)});
  }
  return references;
}

std::vector<PrimitiveRef> References(const TriangleMesh& mesh) {
  const core::PrimitiveRefArray references = core::MakePrimitiveRefs(mesh);
  return {references.begin(), references.end()};
}

struct Counted {
  std::size_t below = 0, planar = 0, above = 0;
};

Counted CountAt(const std::vector<PrimitiveRef>& references, int axis, float plane) {
  Counted counted;
  for (const PrimitiveRef& r : references) {
    counted.below += r.bounds.min[axis] < plane;
    counted.above += r.bounds.max[axis] > plane;
    counted.planar += r.bounds.min[axis] == plane && r.bounds.max[axis] == plane;
  }
  return counted;
}

// The plainest search: every plane of a list, counted anew.
void ConsiderAll(const std::vector<PrimitiveRef>& references, int axis, std::vector<float> planes,
                 SplitSearch* search) {
  std::sort(planes.begin(), planes.end());
  SplitSearch::Axis candidates(search, axis);
  for (const float plane : planes) {
    const Counted counted = CountAt(references, axis, plane);
    candidates.Consider(plane, counted.below, counted.planar, counted.above);
  }
}

void ExpectSame(const std::optional<SplitCandidate>& a, const std::optional<SplitCandidate>& b) {
  ASSERT_EQ(a.has_value(), b.has_value());
  if (!a) return;
  EXPECT_EQ(a->plane, b->plane);
  EXPECT_EQ(a->planar_below, b->planar_below);
  EXPECT_EQ(a->below, b->below);
  EXPECT_EQ(a->above, b->above);
  EXPECT_EQ(a->cost, b->cost);
}

TEST(SplitEvent, KeepsWhatItIsMadeOf) {
  for (const float position : {-1.0f, -0x1p-149f, 0.0f, 0x1p-149f, 0.3f, 1.0f}) {
    for (const Kind kind : {Kind::kEnd, Kind::kPlanar, Kind::kStart}) {
      for (const std::uint32_t slot : {0u, 7u, SplitEvent::kMaxSlot}) {
        const SplitEvent event(position, kind, slot);
        EXPECT_EQ(event.position(), position);
        EXPECT_EQ(event.kind(), kind);
        EXPECT_EQ(event.slot(), slot);
      }
    }
  }
}

TEST(SplitEvent, OrdersByPositionThenEndPlanarStartThenSlot) {
  const std::vector<SplitEvent> ordered = {
      {-1.0f, Kind::kStart, 9},   {-0.5f, Kind::kEnd, 9},  {-0x1p-149f, Kind::kEnd, 9},
      {0.0f, Kind::kEnd, 5},      {-0.0f, Kind::kEnd, 6},  {-0.0f, Kind::kPlanar, 1},
      {0.0f, Kind::kPlanar, 2},   {0.0f, Kind::kStart, 0}, {-0.0f, Kind::kStart, 1},
      {0x1p-149f, Kind::kEnd, 0}, {0.5f, Kind::kEnd, 0},   {1.0f, Kind::kEnd, 0}};
  for (std::size_t i = 0; i + 1 < ordered.size(); ++i) EXPECT_LT(ordered[i], ordered[i + 1]) << i;
}

TEST(EventSorter, SortsAsComparisonsDo) {
  std::mt19937_64 engine = RandomEngine(26);
  core::EventSorter sorter;
  for (const std::size_t count : {0u, 1u, 9u, 256u, 3000u}) {
    std::vector<PrimitiveRef> references(count);
    for (std::size_t i = 0; i < count; ++i) {
      references[i].id = static_cast<core::PrimitiveId>(i);
      for (int axis = 0; axis < 3; ++axis) {
        // Few places, so that many are equal; both signs, both zeros, and some planar.
        const float low = static_cast<float>(static_cast<int>(engine() % 15) - 7) * 0x1p-130f;
        references[i].bounds.min[axis] = engine() % 2 == 0 ? low : -low;
        references[i].bounds.max[axis] =
            references[i].bounds.min[axis] + static_cast<float>(engine() % 3) * 0.25f;
      }
    }
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<SplitEvent> expected;
      for (std::uint32_t slot = 0; slot < count; ++slot) {
        SplitEvent events[2];
        const std::size_t made = core::MakeEvents(references[slot].bounds.min[axis],
                                                  references[slot].bounds.max[axis], slot, events);
        expected.insert(expected.end(), events, events + made);
      }
      std::ranges::sort(expected);
      std::vector<SplitEvent> sorted;
      sorter.Sort(references, axis, &sorted);
      ASSERT_EQ(sorted, expected) << count << " references, axis " << axis;
    }
  }
}

// None is planar; some reach beyond the unit cell.
std::vector<PrimitiveRef> ScatteredReferences(std::mt19937_64& engine, std::size_t count) {
  std::uniform_real_distribution<float> place(-0.05f, 1.0f);
  std::uniform_real_distribution<float> width(0x1p-20f, 0.1f);
  std::vector<PrimitiveRef> references(count);
  for (PrimitiveRef& reference : references) {
    for (int axis = 0; axis < 3; ++axis) {
      reference.bounds.min[axis] = place(engine);
      reference.bounds.max[axis] = reference.bounds.min[axis] + width(engine);
    }
  }
  return references;
}

TEST(SweepAxis, FindsWhatCountingAnewAtEveryEndFinds) {
  std::mt19937_64 engine = RandomEngine(1);
  const SahCost cost{1, 1.5, 0.8};
  const std::vector<double> costs = SubtreeCosts(cost, 256);
  for (int trial = 0; trial < 2000; ++trial) {
    // With planar triangles and equal places, or without any.
    const std::vector<PrimitiveRef> references =
        trial % 2 == 0 ? GridReferences(engine, 1 + engine() % 40)
                       : ScatteredReferences(engine, 1 + engine() % 256);
    SplitSearch sweep(cost, kUnitCell, references.size());
    SplitSearch plain(cost, kUnitCell, references.size());
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<SplitEvent> events;
      std::vector<float> ends;
      for (std::uint32_t slot = 0; slot < references.size(); ++slot) {
        const float low = references[slot].bounds.min[axis];
        const float high = references[slot].bounds.max[axis];
        SplitEvent made[2];
        events.insert(events.end(), made, made + MakeEvents(low, high, slot, made));
        ends.insert(ends.end(), {low, high});
      }
      std::sort(events.begin(), events.end());
      SweepAxis(events, axis, references.size(), costs, &sweep);
      ConsiderAll(references, axis, ends, &plain);
    }
    // Planes of equal cost are tried in another order.
    ASSERT_EQ(sweep.best().has_value(), plain.best().has_value());
    if (!plain.best()) continue;
    EXPECT_EQ(sweep.best()->cost, plain.best()->cost);
    const SideCounts counts = CountSides(references, *sweep.best());
    EXPECT_EQ(counts.below, sweep.best()->below);
    EXPECT_EQ(counts.above, sweep.best()->above);
  }
}

// The planes as they are promised, found by plain counting: multiples of the power of two that
// makes 16 to 32 bins.
std::vector<float> EvenPlanes(float low, float high) {
  std::vector<float> planes;
  if (low == high) return planes;
  const double width = static_cast<double>(high) - static_cast<double>(low);
  double spacing = 1;
  while (width / spacing > 32) spacing *= 2;
  while (width / spacing <= 16) spacing /= 2;
  for (double k = std::floor(static_cast<double>(low) / spacing);
       k * spacing < static_cast<double>(high); ++k) {
    if (k * spacing > static_cast<double>(low)) planes.push_back(static_cast<float>(k * spacing));
  }
  return planes;
}

// Triangles on a coarse grid end in planes and lie flat in them; others do not.
TEST(BinnedSplit, CostsNoMoreThanTheBestOfAllItsPlanesCountedAnew) {
  std::mt19937_64 engine = RandomEngine(2);
  const SahCost cost{1, 1.5, 0.8};
  int found = 0, planar = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<PrimitiveRef> references = GridReferences(engine, 1 + engine() % 200);
    if (trial % 2 == 0) {
      for (PrimitiveRef& r : references) {
        for (int axis = 0; axis < 3; ++axis) {
          r.bounds.min[axis] -= 0x1p-20f * static_cast<float>(engine() % 1000);
        }
      }
    }
    const Bounds3f bounds = core::UnionBounds(references);
    SplitSearch plain(cost, kUnitCell, references.size());
    for (int axis = 0; axis < 3; ++axis) {
      SplitSearch::Axis candidates(&plain, axis);
      candidates.ConsiderEmptyBelow(bounds.min[axis]);
      candidates.ConsiderEmptyAbove(bounds.max[axis]);
      ConsiderAll(references, axis, EvenPlanes(bounds.min[axis], bounds.max[axis]), &plain);
    }
    const auto binned = BinnedCounts(references, bounds).FindSplit(kUnitCell, cost);
    ASSERT_EQ(binned.has_value(), plain.best().has_value());
    if (!binned) continue;
    // Floats choose among planes of equal cost as they like.
    EXPECT_NEAR(binned->cost, plain.best()->cost, 1e-5 * binned->cost);
    const SideCounts counts = CountSides(references, *binned);
    EXPECT_EQ(counts.below, binned->below);
    EXPECT_EQ(counts.above, binned->above);
    ++found;
    planar += binned->below + binned->above == references.size();
  }
  EXPECT_GT(found, 1000);
  EXPECT_GT(planar, 100);
}

// Few floats lie between the ends, near 1 or near 0; all of them, and no more, may be planes.
TEST(BinnedSplit, HoldsForBoundsAFewFloatsWide) {
  for (const float low : {0.75f, 0.0f, -0x1p-149f, -1.0f}) {
    for (int width = 1; width < 40; ++width) {
      std::vector<PrimitiveRef> references;
      float high = low;
      for (int i = 0; i < width; ++i) {
        const float end = std::nextafter(high, 2.0f);
        for (int copy = 0; copy < 9; ++copy) {
          references.push_back({Bounds3f{{high, -1, -1}, {end, 1, 1}}, 0});
        }
        high = end;
      }
      const Bounds3f bounds = core::UnionBounds(references);
      const Bounds3f cell{{low, -1, -1}, {high, 1, 1}};
      const auto split = BinnedCounts(references, bounds).FindSplit(cell, SahCost{0.1, 1, 1});
      if (!split) continue;
      EXPECT_TRUE(split->plane.IsInside(cell));
      const SideCounts counts = CountSides(references, *split);
      EXPECT_EQ(counts.below, split->below);
      EXPECT_EQ(counts.above, split->above);
    }
  }
}

TEST(BinnedSplit, CutsOffEmptySpaceExactly) {
  const std::vector<PrimitiveRef> references = {{Bounds3f{{-0.3f, -1, -1}, {-0.1f, 1, 1}}, 0},
                                                {Bounds3f{{-0.2f, -1, -1}, {0.7f, 1, 1}}, 1}};
  const auto split = BinnedCounts(references, core::UnionBounds(references))
                         .FindSplit(kUnitCell, SahCost{1, 10, 0.1});
  ASSERT_TRUE(split);
  EXPECT_EQ(split->plane, (core::SplitPlane{0, -0.3f}));
  EXPECT_EQ(split->below, 0u);
  EXPECT_EQ(split->above, 2u);
}

TEST(BinnedSplit, IsTheSameForEveryNumberOfThreads) {
  const TriangleMesh mesh = TriangleMesh::Create(Soup(60'000, 0.02, 3)).value();
  const std::vector<PrimitiveRef> references = References(mesh);
  const Bounds3f cell = core::UnionBounds(references);
  const auto alone = BinnedCounts(references, cell).FindSplit(cell, SahCost{});
  ASSERT_TRUE(alone);
  const SideCounts counts = CountSides(references, *alone);
  EXPECT_EQ(counts.below, alone->below);
  EXPECT_EQ(counts.above, alone->above);
  for (const int threads : {1, 2, 4}) {
    core::Arena arena(threads);
    arena.Run(
        [&] { ExpectSame(BinnedCounts(references, cell).FindSplit(cell, SahCost{}), alone); });
  }
}

std::vector<float> Centroids(const TriangleMesh& mesh, int axis) {
  std::vector<float> centroids;
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    const core::PrimitiveId id = static_cast<core::PrimitiveId>(i);
    const double sum = mesh.LocalCorner(id, 0)[axis] + mesh.LocalCorner(id, 1)[axis] +
                       mesh.LocalCorner(id, 2)[axis];
    centroids.push_back(static_cast<float>(sum / 3));
  }
  return centroids;
}

TEST(CyclicSplit, FindsWhatTheNotesAlgorithm1Finds) {
  const SahCost cost{1, 1.5, 0.8};
  for (const auto& data : {Soup(200, 0.2, 4), UvSphere({0, 0, 0}, 1, 8, 12),
                           Join(Grid(5, 0, 0.5), Grid(5, 2, 0.25))}) {
    const TriangleMesh mesh = TriangleMesh::Create(data).value();
    const std::vector<PrimitiveRef> references = References(mesh);
    const Bounds3f cell = core::UnionBounds(references);
    core::CentroidSplitFinder finder(mesh, cost);
    for (int depth = 0; depth < 6; ++depth) {
      SplitSearch plain(cost, cell, references.size());
      ConsiderAll(references, depth % 3, Centroids(mesh, depth % 3), &plain);
      ASSERT_TRUE(plain.best());
      ExpectSame(finder.FindCyclic(references, cell, depth), plain.best());
    }
  }
}

TEST(CyclicSplit, TakesTheNextAxisWhereNoPlaneBeatsTheLeaf) {
  const TriangleMesh mesh = TriangleMesh::Create(Grid(8, 2, 0.5)).value();
  const std::vector<PrimitiveRef> references = References(mesh);
  const SahCost cost;
  core::CentroidSplitFinder finder(mesh, cost);
  const auto split = finder.FindCyclic(references, core::UnionBounds(references), 2);
  ASSERT_TRUE(split);
  EXPECT_EQ(split->plane.axis, 0);
}

TEST(MedianSplit, HalvesTrianglesThatAreApart) {
  const TriangleMesh mesh = TriangleMesh::Create(Staircase(64)).value();
  const std::vector<PrimitiveRef> references = References(mesh);
  const SahCost cost;
  core::CentroidSplitFinder finder(mesh, cost);
  for (int depth = 0; depth < 6; ++depth) {
    const auto split = finder.FindMedian(references, core::UnionBounds(references), depth);
    ASSERT_TRUE(split);
    EXPECT_EQ(split->plane.axis, depth % 3);
    EXPECT_EQ(split->below, 32u);
    EXPECT_EQ(split->above, 32u);
  }
}

TEST(MedianSplit, FindsNothingWhenEveryPlaneKeepsEverythingTogether) {
  const TriangleMesh mesh = TriangleMesh::Create(Coincident(50)).value();
  const std::vector<PrimitiveRef> references = References(mesh);
  const SahCost cost;
  core::CentroidSplitFinder finder(mesh, cost);
  EXPECT_FALSE(finder.FindMedian(references, core::UnionBounds(references), 0));
}

TEST(SideOf, SendsTrianglesThatEndInThePlaneToOneSide) {
  const SplitCandidate split{{0, 0.5f}, true, 0, 0, 0};
  SplitCandidate above = split;
  above.planar_below = false;
  const auto at = [](float low, float high) {
    return PrimitiveRef{Bounds3f{{low, 0, 0}, {high, 1, 1}}, 0};
  };
  EXPECT_EQ(SideOf(at(0, 0.5f), split), Side::kBelow);
  EXPECT_EQ(SideOf(at(0.5f, 1), split), Side::kAbove);
  EXPECT_EQ(SideOf(at(0.25f, 0.75f), split), Side::kBoth);
  EXPECT_EQ(SideOf(at(0.5f, 0.5f), split), Side::kBelow);
  EXPECT_EQ(SideOf(at(0.5f, 0.5f), above), Side::kAbove);
}

TEST(Distribute, GivesTheSameInParallelAndDropsPartsThatAreEmpty) {
  const TriangleMesh mesh = TriangleMesh::Create(Soup(30'000, 0.3, 5)).value();
  const Bounds3f whole = core::UnionBounds(References(mesh));
  // Bounds that reach beyond the cell's part of many triangles, so that some parts are empty.
  const std::vector<PrimitiveRef> references = References(mesh);
  const core::SplitPlane plane{1, whole.min.y * 0.5f + whole.max.y * 0.5f};
  SplitCandidate split;
  split.plane = plane;
  Bounds3f cell = whole;
  cell.max.x = whole.min.x + 0.3f * (whole.max.x - whole.min.x);

  const SideCounts room = CountSides(references, split);
  std::vector<PrimitiveRef> below(references.size()), cut(references.size());
  std::vector<PrimitiveRef> above = references;  // in place
  const SideCounts used =
      Distribute(mesh, above, cell, split, below.data(), above.data(), cut.data());
  EXPECT_LT(used.below, room.below);
  below.resize(used.below);
  above.resize(used.above);
  for (const PrimitiveRef& r : below) EXPECT_LE(r.bounds.max.y, plane.position);
  for (const PrimitiveRef& r : above) EXPECT_GE(r.bounds.min.y, plane.position);

  core::Arena arena(4);
  arena.Run([&] {
    core::Share share_below, share_above;
    DistributeInParallel(mesh, references, cell, split, &share_below, &share_above);
    EXPECT_EQ(share_below.bounds, core::UnionBounds(below));
    EXPECT_EQ(share_above.bounds, core::UnionBounds(above));
    std::vector<PrimitiveRef> parallel_below(share_below.references.begin(),
                                             share_below.references.end());
    std::vector<PrimitiveRef> parallel_above(share_above.references.begin(),
                                             share_above.references.end());
    // In another order, since each piece of the work puts those that are cut last.
    for (std::vector<PrimitiveRef>* v : {&below, &above, &parallel_below, &parallel_above}) {
      std::ranges::sort(*v, {}, &PrimitiveRef::id);
    }
    EXPECT_EQ(parallel_below, below);
    EXPECT_EQ(parallel_above, above);
  });
}

}  // namespace
}  // namespace kdray::test
