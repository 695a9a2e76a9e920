// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/ring_boxes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

namespace kdray::core {
namespace {

std::vector<Point2> Circle(int corners) {
  std::vector<Point2> points;
  for (int i = 0; i < corners; ++i) {
    points.push_back({std::cos(0.001 * i), std::sin(0.001 * i)});
  }
  return points;
}

class RingBoxesTest : public testing::Test {
 protected:
  RingBoxesTest() {
    ring_.Reset(points_);
    std::iota(all_.begin(), all_.end(), 0U);
  }
  std::vector<std::uint32_t> VisitedBy(const RingBoxes& boxes) {
    meter_.Allow(1'000'000);
    std::vector<std::uint32_t> visited;
    boxes.Visit({{{-9, -9}, {9, -9}, {0, 20}}}, [&](std::uint32_t i) {
      visited.push_back(i);
      return false;
    });
    return visited;
  }

  const std::vector<Point2> points_ = Circle(5000);
  std::vector<std::uint32_t> all_ = std::vector<std::uint32_t>(5000);
  Ring ring_;
  CutMeter meter_{CancelToken()};
};

TEST_F(RingBoxesTest, VisitEachCornerUntilItIsRemoved) {
  meter_.Allow(100'000'000);
  RingBoxes boxes(&ring_, &meter_);
  boxes.Build(all_, RingBoxes::Over::kCorners);
  EXPECT_EQ(VisitedBy(boxes).size(), 5000u);
  for (std::uint32_t i = 1; i < 5000; i += 2) {
    ring_.Remove(i);
    boxes.Remove(i, i - 1);
  }
  const std::vector<std::uint32_t> visited = VisitedBy(boxes);
  EXPECT_EQ(visited.size(), 2500u);
  for (const std::uint32_t i : visited) EXPECT_EQ(i % 2, 0u);
}

// Half a tree has corners without a leaf: removing one of them wrote before the array.
TEST_F(RingBoxesTest, AreEmptyWhereverTheMeterStopsTheBuild) {
  for (std::uint64_t steps = 0; steps < 1'000'000; steps = 2 * steps + 1) {
    CutMeter meter{CancelToken()};
    meter.Allow(steps);
    RingBoxes boxes(&ring_, &meter);
    boxes.Build(all_, RingBoxes::Over::kEdges);
    ASSERT_TRUE(meter.stopped()) << steps;
    EXPECT_EQ(boxes.built_size(), 0u) << steps;
    EXPECT_TRUE(VisitedBy(boxes).empty()) << steps;
    boxes.Remove(4999, 4998);
  }
}

}  // namespace
}  // namespace kdray::core
