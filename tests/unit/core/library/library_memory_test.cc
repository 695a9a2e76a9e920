// SPDX-License-Identifier: Apache-2.0
// Builds and loads that share little memory: who waits, who passes, who is turned away.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include "core/library/parse_mesh.h"
#include "core/library/tree_library.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::CancelToken;
using core::ErrorCode;
using core::TreeId;
using core::TreeLibrary;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

// A library whose memory is just what the build of a large mesh needs: while the
// small one is held, the large one waits.
class FullMemoryTest : public LibraryTest {
 protected:
  static constexpr int kRings = 20;
  FullMemoryTest() {
    Open();
    const TreeId large = Add(Large(), BuildKind::kKdSah);
    const core::MeshFacts mesh = *library_->Find(large)->record.mesh;
    options_.memory_limit_bytes =
        std::max(mesh.memory_bytes + core::EstimateBuildBytes(mesh.triangles, BuildKind::kKdSah),
                 core::EstimateParseBytes(mesh.file_bytes));
    EXPECT_TRUE(library_->Delete(large).ok());
    Open();
    small_ = Add(SphereBytes(1, 6), BuildKind::kBox);
  }
  static std::vector<std::byte> Large() { return SphereBytes(2, kRings); }
  core::Scene HoldSmall() {
    auto loaded = library_->Load(small_, Soon());
    EXPECT_TRUE(loaded.ok());
    return *std::move(loaded);
  }
  TreeId UploadLarge() {
    const auto added = Upload(library_.get(), Large(), BuildKind::kKdSah);
    EXPECT_TRUE(added.ok());
    return added->id;
  }

  TreeId small_;
};

TEST_F(FullMemoryTest, AMeshThatCouldNeverFitIsTooLarge) {
  const auto upload = library_->BeginUpload(options_.memory_limit_bytes);
  ASSERT_FALSE(upload.ok());
  EXPECT_EQ(upload.error().code, ErrorCode::kMeshTooLarge);
  // Fits while it comes in, but its build never could.
  const auto added = Upload(library_.get(), SphereBytes(9, kRings + 4), BuildKind::kKdSah);
  ASSERT_TRUE(added.ok());
  EXPECT_EQ(library_->Load(added->id, Soon()).error().code, ErrorCode::kMeshTooLarge);
  EXPECT_EQ(CodeOfFind(added->id), ErrorCode::kMeshTooLarge);
  EXPECT_EQ(library_->List(std::nullopt, std::nullopt, 10).size(), 1u);
}

TEST_F(FullMemoryTest, UploadsUnderWayExcludeNobody) {
  const std::uint64_t bytes = options_.memory_limit_bytes / 2;
  std::vector<TreeLibrary::Upload> slow;
  for (int i = 0; i < 20; ++i) {
    auto upload = library_->BeginUpload(bytes);
    ASSERT_TRUE(upload.ok()) << upload.error().message;
    ASSERT_TRUE(upload->Append(Bytes("OFF\n")).ok());
    slow.push_back(*std::move(upload));
  }
  const TreeId id = Add(SphereBytes(3, 6), BuildKind::kBox);
  EXPECT_TRUE(library_->Load(id, Soon()).ok());
}

TEST_F(FullMemoryTest, UploadsBeyondTheMemoryOfTheBuildsUnderWayAreTurnedAwayAtTheDoor) {
  const std::optional<core::Scene> held = HoldSmall();
  const TreeId waiting = UploadLarge();
  EXPECT_FALSE(library_->Find(waiting)->ready());
  const auto refused = library_->BeginUpload(options_.memory_limit_bytes / 5);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::kMemoryFull);
  EXPECT_TRUE(library_->Delete(waiting).ok());
  EXPECT_TRUE(library_->BeginUpload(options_.memory_limit_bytes / 5).ok());
}

TEST_F(FullMemoryTest, SmallBuildsAndLoadsPassLargeBuildsThatWait) {
  const TreeId on_disk = Add(SphereBytes(3, 6), BuildKind::kBox);
  Settle();
  const std::optional<core::Scene> held = HoldSmall();
  // More of them than threads that build.
  std::vector<TreeId> waiting;
  for (int i = 0; i < 4; ++i) {
    const auto added = Upload(library_.get(), SphereBytes(20 + i, kRings), BuildKind::kKdSah);
    ASSERT_TRUE(added.ok()) << added.error().message;
    waiting.push_back(added->id);
  }
  const TreeId small = Add(SphereBytes(4, 6), BuildKind::kBox);
  EXPECT_TRUE(library_->Load(small, Soon()).ok());
  EXPECT_TRUE(library_->Load(on_disk, Soon()).ok());
  for (const TreeId& id : waiting) {
    const auto info = library_->Find(id);
    ASSERT_TRUE(info.ok());
    EXPECT_FALSE(info->ready());
  }
}

TEST_F(FullMemoryTest, ABuildWaitsForMemoryAndGoesOnWhenItIsFree) {
  std::optional<core::Scene> held = HoldSmall();
  const TreeId large = UploadLarge();
  const auto late = library_->Load(large, Within(milliseconds(300)));
  ASSERT_FALSE(late.ok());
  EXPECT_EQ(late.error().code, ErrorCode::kMemoryFull);
  EXPECT_TRUE(library_->Find(large).ok());
  EXPECT_FALSE(library_->Find(large)->ready());
  held.reset();
  EXPECT_TRUE(library_->Load(large, Soon()).ok());
}

TEST_F(FullMemoryTest, WhoLeavesWhileItIsBuiltLeavesTheOthersWaiting) {
  std::optional<core::Scene> held = HoldSmall();
  const TreeId large = UploadLarge();
  const CancelToken leader = CancelToken::Cancellable();
  std::thread first_client([&] {
    const auto loaded = library_->Load(large, leader);
    EXPECT_FALSE(loaded.ok());
    EXPECT_EQ(loaded.error().code, ErrorCode::kCancelled);
  });
  std::thread second_client([&] { EXPECT_TRUE(library_->Load(large, Soon()).ok()); });
  const auto start = steady_clock::now();
  leader.Cancel();
  first_client.join();
  EXPECT_LT(steady_clock::now() - start, std::chrono::seconds(10));
  held.reset();
  second_client.join();
}

TEST_F(FullMemoryTest, DeletingATreeThatIsBuiltTellsAllWhoWaitAndLeavesNothing) {
  std::optional<core::Scene> held = HoldSmall();
  const TreeId large = UploadLarge();
  std::atomic<int> told{0};
  std::vector<std::thread> clients;
  for (int i = 0; i < 20; ++i) {
    clients.emplace_back([&] {
      const auto loaded = library_->Load(large, Soon());
      if (!loaded.ok() && loaded.error().code == ErrorCode::kNotFound) ++told;
    });
  }
  ASSERT_TRUE(library_->Delete(large).ok());
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(told, 20);
  EXPECT_EQ(CodeOfFind(large), ErrorCode::kNotFound);
  EXPECT_EQ(FilesIn("meshes"), 1u);
  held.reset();
  // And again, as if it had never been there.
  const auto again = Upload(library_.get(), Large(), BuildKind::kKdSah);
  ASSERT_TRUE(again.ok());
  EXPECT_FALSE(again->existed);
  EXPECT_TRUE(library_->Load(again->id, Soon()).ok());
}

TEST_F(FullMemoryTest, ShuttingDownTellsAllWhoWaitAndTheBuildResumes) {
  std::optional<core::Scene> held = HoldSmall();
  const TreeId large = UploadLarge();
  std::thread client([&] {
    const auto loaded = library_->Load(large, Soon());
    EXPECT_FALSE(loaded.ok());
    EXPECT_EQ(loaded.error().code, ErrorCode::kCancelled);
  });
  library_->Shutdown();
  client.join();
  EXPECT_FALSE(library_->Load(large, Soon()).ok()) << "and no load waits after it";
  held.reset();
  Open();
  EXPECT_TRUE(library_->Load(large, Soon()).ok());
  EXPECT_EQ(library_->counters().builds, 1u);
}

}  // namespace
}  // namespace kdray::test
