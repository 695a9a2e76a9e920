// SPDX-License-Identifier: Apache-2.0
// Binary trees that are made again for cells: once for all who ask, in memory that is reserved.
#include "core/library/binary_rebuilder.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "core/accel/tree.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using std::chrono::milliseconds;

const Sha256Digest kMesh = HashBytes(std::as_bytes(std::span("a mesh")));

Scene MakeScene(BuildKind build) {
  auto mesh = std::make_shared<const TriangleMesh>(
      TriangleMesh::Create(test::UvSphere({0, 0, 0}, 1, 30, 40)).value());
  auto tree = std::make_shared<const Tree>(BuildTree(*mesh, build).value());
  return {std::move(mesh), std::move(tree)};
}

std::uint64_t OwnBytes(const Scene& scene) {
  return scene.mesh->bytes() + scene.tree->most_bytes();
}
std::uint64_t EstimateOf(const Scene& scene) {
  return EstimateBuildBytes(scene.mesh->triangle_count(), scene.tree->build);
}

CancelToken Soon() {
  return CancelToken::WithDeadline(std::chrono::steady_clock::now() + std::chrono::minutes(2));
}

// A budget that holds one tree, with room for one rebuild of it and not for two. Memory that
// the test holds makes a rebuild stop at its reservation until the test lets it go on.
class BinaryRebuilderTest : public testing::Test {
 protected:
  BinaryRebuilderTest()
      : scene_(MakeScene(BuildKind::kKdSah)),
        budget_(OwnBytes(scene_) + EstimateOf(scene_) * 3 / 2) {
    budget_.set_reclaim([this](std::uint64_t bytes) -> std::uint64_t {
      if (!others_) return 0;
      is_at_reservation_.set_value();
      may_go_on_.get_future().wait();
      others_.reset();
      return bytes;
    });
    own_ = budget_.TryReserve(OwnBytes(scene_));
  }
  void Hold() { others_ = budget_.TryReserve(budget_.limit() - budget_.used()); }
  void WaitUntilHeld() { is_at_reservation_.get_future().wait(); }
  void LetGoOn() { may_go_on_.set_value(); }
  std::uint64_t UsedByRebuilds() const { return budget_.used() - OwnBytes(scene_); }
  // A request in a thread of its own.
  class Asker {
   public:
    explicit Asker(BinaryRebuilderTest* test)
        : cancel_(CancelToken::When([this] {
            // Looked at for the first time when the asker begins to wait.
            if (!waits_.exchange(true)) begins_to_wait_.set_value();
            return leaves_.load();
          })),
          status_(std::async(std::launch::async, [this, test] {
            return test->rebuilder_.Ensure(kMesh, test->scene_, cancel_);
          })) {
      begins_to_wait_.get_future().wait();
    }
    void Leave() { leaves_ = true; }
    Status status() { return status_.get(); }
    bool IsWaiting() const {
      return status_.wait_for(milliseconds(0)) == std::future_status::timeout;
    }

   private:
    std::atomic<bool> waits_{false};
    std::atomic<bool> leaves_{false};
    std::promise<void> begins_to_wait_;
    CancelToken cancel_;
    std::future<Status> status_;
  };

  const Scene scene_;
  MemoryBudget budget_;
  std::optional<MemoryCharge> own_;
  std::optional<MemoryCharge> others_;
  std::promise<void> is_at_reservation_;
  std::promise<void> may_go_on_;
  Arena arena_{2};
  BinaryRebuilder rebuilder_{&budget_, &arena_};
};

TEST_F(BinaryRebuilderTest, MakesTheTreeThatWasBuilt) {
  for (const BuildKind build : kAllBuildKinds) {
    const Scene scene = MakeScene(build);
    MemoryBudget budget(std::uint64_t{1} << 30);
    BinaryRebuilder rebuilder(&budget, &arena_);
    EXPECT_EQ(scene.tree->kept_binary(), nullptr);
    ASSERT_TRUE(rebuilder.Ensure(kMesh, scene, Soon()).ok());
    ASSERT_NE(scene.tree->kept_binary(), nullptr);
    EXPECT_EQ(budget.used(), 0u);
    const auto cells = scene.Cells(3, 1000);
    const auto expected = MakeScene(build).Cells(3, 1000);
    ASSERT_TRUE(cells.ok() && expected.ok());
    ASSERT_EQ(cells->size(), expected->size());
    for (std::size_t i = 0; i < cells->size(); ++i) {
      EXPECT_EQ((*cells)[i].bounds, (*expected)[i].bounds) << Name(build);
    }
  }
}

TEST_F(BinaryRebuilderTest, MakesOneForAllWhoAskAndReservesOnce) {
  Hold();
  std::vector<std::unique_ptr<Asker>> askers;
  for (int i = 0; i < 30; ++i) askers.push_back(std::make_unique<Asker>(this));
  WaitUntilHeld();
  LetGoOn();
  for (const auto& asker : askers) EXPECT_TRUE(asker->status().ok()) << "there is room for one";
  EXPECT_NE(scene_.tree->kept_binary(), nullptr);
  EXPECT_EQ(rebuilder_.rebuilds(), 1u);
  EXPECT_EQ(UsedByRebuilds(), 0u) << "the reservation is given back";
  EXPECT_TRUE(rebuilder_.Ensure(kMesh, scene_, Soon()).ok());
  EXPECT_EQ(rebuilder_.rebuilds(), 1u) << "the tree keeps it";
}

TEST_F(BinaryRebuilderTest, WhoLeavesDoesNotHarmTheOthers) {
  Hold();
  Asker first(this);
  Asker second(this);
  Asker third(this);
  WaitUntilHeld();
  first.Leave();
  EXPECT_EQ(first.status().error().code, ErrorCode::kCancelled);
  third.Leave();
  EXPECT_EQ(third.status().error().code, ErrorCode::kCancelled);
  const CancelToken late = CancelToken::WithDeadline(std::chrono::steady_clock::now());
  EXPECT_EQ(rebuilder_.Ensure(kMesh, scene_, late).error().code, ErrorCode::kDeadlineExceeded);
  EXPECT_TRUE(second.IsWaiting());
  LetGoOn();
  EXPECT_TRUE(second.status().ok());
  EXPECT_EQ(rebuilder_.rebuilds(), 1u);
}

TEST_F(BinaryRebuilderTest, EndsWhenTheLastAskerLeavesAndIsMadeForTheNext) {
  Hold();
  Asker first(this);
  Asker second(this);
  WaitUntilHeld();
  first.Leave();
  second.Leave();
  EXPECT_EQ(first.status().error().code, ErrorCode::kCancelled);
  EXPECT_EQ(second.status().error().code, ErrorCode::kCancelled);
  Asker next(this);
  LetGoOn();
  EXPECT_TRUE(next.status().ok());
  EXPECT_EQ(rebuilder_.rebuilds(), 1u) << "the first was stopped";
  EXPECT_EQ(UsedByRebuilds(), 0u);
}

TEST_F(BinaryRebuilderTest, IsRefusedAtOnceWhenTheMemoryIsNotFree) {
  std::optional<MemoryCharge> others = budget_.TryReserve(EstimateOf(scene_));
  ASSERT_TRUE(others.has_value());
  const Status refused = rebuilder_.Ensure(kMesh, scene_, Soon());
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::kMemoryFull);
  EXPECT_EQ(scene_.tree->kept_binary(), nullptr);
  others.reset();
  EXPECT_TRUE(rebuilder_.Ensure(kMesh, scene_, Soon()).ok());
}

TEST_F(BinaryRebuilderTest, ATreeThatFitsHasCellsHoweverSmallTheLimit) {
  MemoryBudget budget(OwnBytes(scene_) + 1000);
  BinaryRebuilder rebuilder(&budget, &arena_);
  const std::optional<MemoryCharge> own = budget.TryReserve(OwnBytes(scene_));
  std::optional<MemoryCharge> other = budget.TryReserve(1);
  EXPECT_EQ(rebuilder.Ensure(kMesh, scene_, Soon()).error().code, ErrorCode::kMemoryFull)
      << "it is made alone";
  other.reset();
  EXPECT_TRUE(rebuilder.Ensure(kMesh, scene_, Soon()).ok());
}

TEST_F(BinaryRebuilderTest, StoppingTellsAllWhoWait) {
  Hold();
  std::vector<std::unique_ptr<Asker>> askers;
  for (int i = 0; i < 3; ++i) askers.push_back(std::make_unique<Asker>(this));
  WaitUntilHeld();
  std::thread stop([&] { rebuilder_.Stop(); });
  for (const auto& asker : askers) {
    EXPECT_EQ(asker->status().error().code, ErrorCode::kCancelled);
  }
  LetGoOn();
  stop.join();
  EXPECT_EQ(UsedByRebuilds(), 0u);
  EXPECT_EQ(rebuilder_.Ensure(kMesh, scene_, Soon()).error().code, ErrorCode::kCancelled);
}

}  // namespace
}  // namespace kdray::core
