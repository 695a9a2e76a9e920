// SPDX-License-Identifier: Apache-2.0
// Libraries that share trees through an object store: each sees what the others did.
#include "core/library/shared_trees.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tests/unit/core/library/shared_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::ErrorCode;
using core::TreeId;
using core::TreeInfo;
using core::TreeLibrary;
using std::chrono::milliseconds;
using Fault = MemoryObjectStore::Fault;
using Call = MemoryObjectStore::Call;

class SharedTreesTest : public SharedLibraryTest {
 protected:
  SharedTreesTest() { OpenBoth(); }
  void SetAway(bool is_away) {
    if (!is_away) return objects_.set_faults(nullptr);
    objects_.set_faults([](Call, std::string_view) { return Fault::kAway; });
  }
};

TEST_F(SharedTreesTest, WhatOneLibraryTookTheOtherAnswersWithoutABuild) {
  const TreeId id = Add(0, SphereBytes(1), BuildKind::kBvh);
  WaitForTree();
  EXPECT_EQ(AnswersOf(&library(1), id), AnswersOf(&library(0), id));
  const core::LibraryCounters counters = library(1).counters();
  EXPECT_EQ(counters.builds, 0u);
  EXPECT_EQ(counters.loads, 1u);
  EXPECT_EQ(counters.shared->meshes.fetched, 1u);
  EXPECT_EQ(counters.shared->trees.fetched, 1u);
  const auto first = library(0).counters().shared;
  EXPECT_GE(first->meshes.here, 1u) << "whoever took a mesh has its file";
  EXPECT_EQ(first->meshes.fetched, 0u);
  EXPECT_EQ(first->trees.fetched, 0u);
  const auto info = library(1).Find(id);
  ASSERT_TRUE(info.ok());
  const core::TreeRecord original = library(0).Find(id)->record;
  EXPECT_EQ(info->record.created_ms, original.created_ms);
  EXPECT_EQ(info->record.tree, original.tree);
  const auto file = library(1).OpenMesh(id);
  ASSERT_TRUE(file.ok());
  EXPECT_EQ((*file)->size(), SphereBytes(1).size());
}

TEST_F(SharedTreesTest, AnIdThatNobodyHasIsNotFound) {
  const TreeId id{DigestOf(SphereBytes(1)), std::nullopt};
  EXPECT_EQ(library(0).Find(id).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(CodeOfLoad(0, id), ErrorCode::kNotFound);
  EXPECT_EQ(library(0).OpenMesh(id).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(library(0).LoadAttributes(id, {}, Soon()).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(library(0).Measure(id, {}).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(library(0).Delete(id).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(library(0).AddBuild(id.mesh, BuildKind::kBox).error().code, ErrorCode::kNotFound);
}

TEST_F(SharedTreesTest, ADeletionHoldsForTheOtherLibraryToo) {
  const TreeId id = Add(0, SphereBytes(1));
  EXPECT_EQ(CodeOfLoad(1, id), std::nullopt);
  ASSERT_TRUE(library(1).Delete(id).ok());
  EXPECT_EQ(CodeOfLoad(0, id), ErrorCode::kNotFound);
  EXPECT_EQ(CodeOfLoad(1, id), ErrorCode::kNotFound);
  EXPECT_EQ(library(0).Delete(id).error().code, ErrorCode::kNotFound);
  EXPECT_TRUE(disks_[0].FilesIn("data/meshes").empty());
  EXPECT_TRUE(objects_.Keys("meshes/").empty());
  EXPECT_TRUE(WaitUntil([&] { return objects_.Keys("trees/").empty(); }));
}

TEST_F(SharedTreesTest, ADeletionHoldsAfterTheStatedTimeAndCostsNoRequestBefore) {
  options_[1].shared.confirm_every = milliseconds(400);
  Open(1);
  const TreeId id = Add(0, SphereBytes(1));
  EXPECT_EQ(CodeOfLoad(1, id), std::nullopt);
  ASSERT_TRUE(WaitUntil([&] { return library(1).counters().shared->meshes.fetched == 1; }));
  ASSERT_TRUE(library(0).Delete(id).ok());
  const auto deleted = std::chrono::steady_clock::now();
  const std::uint64_t lookups = library(1).counters().shared->lookups;
  while (std::chrono::steady_clock::now() < deleted + milliseconds(100)) {
    EXPECT_EQ(CodeOfLoad(1, id), std::nullopt) << "still confirmed";
  }
  EXPECT_LE(library(1).counters().shared->lookups, lookups + 1);
  std::this_thread::sleep_until(deleted + milliseconds(400));
  EXPECT_EQ(CodeOfLoad(1, id), ErrorCode::kNotFound);
}

TEST_F(SharedTreesTest, ATreeInUseIsConfirmedWhileNobodyWaits) {
  options_[1].shared.confirm_every = milliseconds(200);
  Open(1);
  const TreeId id = Add(0, SphereBytes(1));
  EXPECT_EQ(CodeOfLoad(1, id), std::nullopt);
  objects_.set_faults([](Call call, std::string_view) {
    if (call == Call::kList) std::this_thread::sleep_for(milliseconds(60));
    return Fault::kNone;
  });
  auto slowest = std::chrono::steady_clock::duration::zero();
  const auto end = std::chrono::steady_clock::now() + milliseconds(700);
  while (std::chrono::steady_clock::now() < end) {
    const auto start = std::chrono::steady_clock::now();
    EXPECT_EQ(CodeOfLoad(1, id), std::nullopt);
    slowest = std::max(slowest, std::chrono::steady_clock::now() - start);
    std::this_thread::sleep_for(milliseconds(2));
  }
  EXPECT_GE(library(1).counters().shared->lookups, 4u);
  EXPECT_LT(slowest, milliseconds(50)) << "a lookup takes 60 ms";
  objects_.set_faults({});
}

TEST_F(SharedTreesTest, AnotherBuildOfAMeshThatOnlyTheStoreHas) {
  const TreeId id = Add(0, SphereBytes(1));
  const auto added = library(1).AddBuild(id.mesh, BuildKind::kBox);
  ASSERT_TRUE(added.ok()) << added.error().message;
  EXPECT_FALSE(added->existed);
  EXPECT_EQ(AnswersOf(&library(0), added->id), AnswersOf(&library(1), added->id));
  ASSERT_TRUE(library(0).Delete(id).ok());
  EXPECT_EQ(CodeOfLoad(1, added->id), std::nullopt);
  const auto again = library(0).AddBuild(id.mesh, BuildKind::kBox);
  ASSERT_TRUE(again.ok());
  EXPECT_TRUE(again->existed);
}

TEST_F(SharedTreesTest, ListsHaveTheTreesOfAllLibrariesInPages) {
  std::vector<TreeId> newest_first;
  for (int i = 0; i < 5; ++i) {
    newest_first.insert(newest_first.begin(), Add(i % 2, SphereBytes(i, 3)));
    std::this_thread::sleep_for(milliseconds(2));
  }
  const TreeId other = Add(0, SphereBytes(0, 3), BuildKind::kBox);
  newest_first.insert(newest_first.begin(), other);
  for (std::size_t i = 0; i < kLibraries; ++i) {
    std::vector<TreeId> listed;
    std::optional<TreeLibrary::Position> after;
    for (;;) {
      const auto page = library(i).ListAll(std::nullopt, after, 4);
      ASSERT_TRUE(page.ok());
      for (const TreeInfo& info : *page) listed.push_back(info.record.id);
      if (page->size() < 4) break;
      after = TreeLibrary::Position{page->back().record.created_ms, page->back().record.id};
    }
    EXPECT_EQ(listed, newest_first);
    const auto one = library(i).ListAll(other.mesh, std::nullopt, 10);
    ASSERT_TRUE(one.ok());
    ASSERT_EQ(one->size(), 2u);
    EXPECT_EQ(one->front().record.id, other);
    EXPECT_TRUE(WaitUntil([&] { return (*library(i).ListAll(other.mesh, {}, 10))[0].ready(); }));
  }
  ASSERT_TRUE(library(1).Delete(other).ok());
  EXPECT_EQ(library(0).ListAll(std::nullopt, std::nullopt, 10)->size(), 5u);
}

TEST_F(SharedTreesTest, WithoutTheStoreKnownTreesAreServedAndNothingElseIs) {
  const TreeId known = Add(0, SphereBytes(1));
  const auto answers = AnswersOf(&library(0), known);
  const TreeId unknown = Add(1, SphereBytes(2));
  SetAway(true);
  EXPECT_EQ(AnswersOf(&library(0), known), answers);
  EXPECT_TRUE(library(0).OpenMesh(known).ok());
  Open(0);  // also after a start
  EXPECT_EQ(AnswersOf(&library(0), known), answers);
  EXPECT_TRUE(IsStoreAway(library(0).Find(unknown).error()));
  EXPECT_TRUE(IsStoreAway(library(0).Load(unknown, Soon()).error()));
  EXPECT_TRUE(IsStoreAway(Upload(&library(0), SphereBytes(3)).error()));
  EXPECT_TRUE(IsStoreAway(library(0).AddBuild(known.mesh, BuildKind::kBox).error()));
  EXPECT_TRUE(IsStoreAway(library(0).Delete(known).error()));
  EXPECT_TRUE(IsStoreAway(library(0).ListAll(std::nullopt, std::nullopt, 10).error()));
  EXPECT_EQ(AnswersOf(&library(0), known), answers) << "a deletion that failed changes nothing";
  SetAway(false);
  EXPECT_EQ(CodeOfLoad(0, unknown), std::nullopt);
  EXPECT_TRUE(Upload(&library(0), SphereBytes(3)).ok());
  EXPECT_TRUE(library(0).Delete(known).ok());
}

TEST_F(SharedTreesTest, AnUploadIsRefusedBeforeItsBytesWhileTheStoreIsAway) {
  options_[0].shared.retries.first_pause = options_[0].shared.retries.most_pause =
      milliseconds(60'000);
  Open(0);
  SetAway(true);
  EXPECT_TRUE(library(0).BeginUpload(100).ok()) << "nobody has asked the store";
  EXPECT_FALSE(Upload(&library(0), SphereBytes(1)).ok());
  EXPECT_TRUE(IsStoreAway(library(0).BeginUpload(100).error()));
}

TEST_F(SharedTreesTest, AMeshThatTheStoreRefusesIsNotStoredHereEither) {
  objects_.set_faults([](Call call, std::string_view) {
    return call == Call::kPut ? Fault::kRefused : Fault::kNone;
  });
  const auto added = Upload(&library(0), SphereBytes(1));
  ASSERT_FALSE(added.ok());
  EXPECT_EQ(added.error().code, ErrorCode::kStoreFull);
  EXPECT_EQ(library(0).counters().trees, 0u);
  EXPECT_TRUE(disks_[0].FilesIn("data/meshes").empty());
}

TEST_F(SharedTreesTest, AMeshThatTheDiskRefusesIsNotTakenFromAnotherWhoAcknowledgedIt) {
  disks_[0].FailAt(6, ErrorCode::kStoreFull);
  const auto refused = Upload(&library(0), SphereBytes(1));
  const auto added = Upload(&library(1), SphereBytes(1));
  ASSERT_TRUE(added.ok());
  EXPECT_EQ(CodeOfLoad(1, added->id), std::nullopt);
  EXPECT_EQ(CodeOfLoad(0, added->id), std::nullopt);
  EXPECT_FALSE(refused.ok());
}

TEST_F(SharedTreesTest, AnAlteredBodyIsFetchedAgainAndNeverUsed) {
  const TreeId id = Add(0, SphereBytes(1), BuildKind::kBvh);
  WaitForTree();
  const auto answers = AnswersOf(&library(0), id);
  for (const std::string_view part : {"catalog/", "meshes/", "trees/"}) {
    for (const Fault fault : {Fault::kAltered, Fault::kTruncated}) {
      ASSERT_TRUE(library(1).Load(id, Soon()).ok());
      libraries_[1].reset();
      disks_[1].~SimulatedDisk();
      new (&disks_[1]) SimulatedDisk;
      objects_.set_faults([part, fault, count = 0](Call call, std::string_view key) mutable {
        return call == Call::kGet && key.starts_with(part) && count++ == 0 ? fault : Fault::kNone;
      });
      Open(1);
      EXPECT_EQ(AnswersOf(&library(1), id), answers) << part;
      objects_.set_faults(nullptr);
    }
  }
}

TEST_F(SharedTreesTest, AMeshWhoseCopiesAreAllDamagedIsCorruptUntilItIsUploadedAgain) {
  const TreeId id = Add(0, SphereBytes(1));
  const std::string key = objects_.Keys("meshes/").at(0);
  std::vector<std::byte> bytes = objects_.Contents(key);
  bytes[bytes.size() / 2] ^= std::byte{1};
  objects_.SetContents(key, bytes);
  EXPECT_EQ(CodeOfLoad(1, id), ErrorCode::kCorrupt);
  objects_.SetContents(key, {});
  EXPECT_EQ(CodeOfLoad(1, id), ErrorCode::kCorrupt);
  ASSERT_TRUE(Upload(&library(1), SphereBytes(1)).ok());
  EXPECT_EQ(CodeOfLoad(1, id), std::nullopt);
}

TEST_F(SharedTreesTest, ADamagedTreeInTheStoreIsBuiltAndReplaced) {
  const TreeId id = Add(0, SphereBytes(1), BuildKind::kBvh);
  WaitForTree();
  const std::string key = objects_.Keys("trees/").at(0);
  const std::vector<std::byte> sound = objects_.Contents(key);
  std::vector<std::byte> damaged = sound;
  damaged[damaged.size() / 2] ^= std::byte{1};
  objects_.SetContents(key, damaged);
  EXPECT_EQ(AnswersOf(&library(1), id), AnswersOf(&library(0), id));
  EXPECT_EQ(library(1).counters().builds, 1u);
  EXPECT_TRUE(WaitUntil(
      [&] { return objects_.Keys("trees/").size() == 1 && objects_.Contents(key) == sound; }));
}

TEST_F(SharedTreesTest, AMeshThatCannotBeReadIsTakenFromTheStore) {
  const auto added = Upload(&library(0), Bytes("OFF\n3 1 0\n0 0 0\n1 0 0\n"));
  ASSERT_TRUE(added.ok());
  EXPECT_FALSE(library(0).Load(added->id, Soon()).ok());
  EXPECT_TRUE(WaitUntil([&] { return objects_.Keys("meshes/").empty(); }));
  EXPECT_EQ(CodeOfLoad(1, added->id), ErrorCode::kNotFound);
  EXPECT_EQ(CodeOfLoad(0, added->id), ErrorCode::kInvalidMesh) << "here its error is kept";
}

TEST_F(SharedTreesTest, WhatTheDiskHasNoRoomForIsFetchedAgain) {
  const auto large = SphereBytes(1, 30);
  options_[1].store_limit_bytes = large.size() + large.size() / 2;
  Open(1);
  const TreeId first = Add(0, large);
  const TreeId second = Add(0, SphereBytes(2, 30));
  const auto answers = AnswersOf(&library(0), first);
  for (int round = 0; round < 3; ++round) {
    EXPECT_EQ(AnswersOf(&library(1), first), answers);
    EXPECT_EQ(CodeOfLoad(1, second), std::nullopt);
    Add(1, SphereBytes(3 + round, 30));  // evicts one of them
  }
  EXPECT_GE(library(1).counters().shared->meshes.fetched, 3u);
}

TEST_F(SharedTreesTest, ADirectoryIsTheCacheOfOneStoreAndNothingElse) {
  const TreeId id = Add(0, SphereBytes(1));
  libraries_[0].reset();
  auto options = options_[0];
  options.shared.store = nullptr;
  EXPECT_EQ(TreeLibrary::Open(options).error().code, ErrorCode::kInvalidArgument)
      << "a cache without its store";
  options = options_[0];
  options.shared.name = "s3://other";
  EXPECT_EQ(TreeLibrary::Open(options).error().code, ErrorCode::kInvalidArgument);
  Open(0);
  EXPECT_EQ(CodeOfLoad(0, id), std::nullopt);

  SimulatedDisk disk;
  options = options_[0];
  options.file_system = &disk;
  options.shared.store = nullptr;
  {
    auto alone = TreeLibrary::Open(options);
    ASSERT_TRUE(alone.ok());
    ASSERT_TRUE(Upload(alone->get(), SphereBytes(2)).ok());
  }
  const auto before = disk.AllFiles();
  options.shared.store = &objects_;
  EXPECT_EQ(TreeLibrary::Open(options).error().code, ErrorCode::kInvalidArgument)
      << "its meshes would be taken for deleted";
  EXPECT_EQ(disk.AllFiles().size(), before.size());
}

TEST_F(SharedTreesTest, AStoreThatRefusesEndsTheStartAndOneThatIsAwayDoesNot) {
  libraries_[0].reset();
  objects_.set_faults([](Call, std::string_view) { return Fault::kRefused; });
  EXPECT_EQ(TreeLibrary::Open(options_[0]).error().code, ErrorCode::kStoreFull);
  SetAway(true);
  EXPECT_TRUE(TreeLibrary::Open(options_[0]).ok());
}

TEST_F(SharedTreesTest, ManyWhoAskForOneTreeFetchItOnce) {
  const TreeId id = Add(0, SphereBytes(1));
  WaitForTree();
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&] {
      EXPECT_TRUE(library(1).Load(id, Soon()).ok());
      EXPECT_TRUE(library(1).OpenMesh(id).ok());
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(library(1).counters().shared->meshes.fetched, 1u);
}

TEST_F(SharedTreesTest, ARequestThatIsCancelledDoesNotWaitForTheStore) {
  const TreeId id = Add(0, SphereBytes(1));
  // The request may still look at it after the test's end.
  const auto is_stuck = std::make_shared<std::atomic<bool>>(true);
  objects_.set_faults([is_stuck](Call, std::string_view) {
    while (*is_stuck) std::this_thread::sleep_for(milliseconds(1));
    return Fault::kNone;
  });
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(library(1).Load(id, Within(milliseconds(20))).error().code,
            ErrorCode::kDeadlineExceeded);
  EXPECT_LT(std::chrono::steady_clock::now() - start, milliseconds(270));
  *is_stuck = false;
}

}  // namespace
}  // namespace kdray::test
