// SPDX-License-Identifier: Apache-2.0
// Builds that were cut off resume at the next start, but not for ever: one that ends the process
// each time waits until its tree is requested.
#include <gtest/gtest.h>

#include <chrono>
#include <optional>
#include <thread>
#include <vector>

#include "core/store/catalog.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::TreeId;
using core::TreeLibrary;
using core::TreeRecord;

class LibraryResumeTest : public LibraryTest {
 protected:
  LibraryResumeTest() {
    Open();
    id_ = Add(mesh_, BuildKind::kBvh);
    library_.reset();
    TreeRecord record;
    record.id = id_;
    record.created_ms = 1'700'000'000'000;
    record.mesh_bytes = mesh_.size();
    SaveAsCutOff(record);
  }

  // As a process leaves it that ends during the first build.
  void SaveAsCutOff(const TreeRecord& record) {
    EXPECT_TRUE(core::Catalog(&disk_, "data/catalog").Save(record).ok());
    disk_.Erase("data/parsed/" + id_.mesh.ToHex());
    disk_.Erase("data/trees/" + id_.ToString());
  }
  TreeRecord RecordOnDisk() {
    const auto contents = core::Catalog(&disk_, "data/catalog").Load();
    EXPECT_TRUE(contents.ok() && contents->records.size() == 1);
    EXPECT_EQ(contents->damaged, 0u);
    return contents->records.at(0);
  }

  // A start whose process ends at operation `n` of the disk; nullopt when it ends before the
  // library is open. Otherwise, how many meshes it parsed.
  std::optional<std::uint64_t> StartAndDieAt(std::uint64_t n) {
    disk_.Restart(SimulatedDisk::Loss::kEverything);
    disk_.DieAt(n);
    auto library = TreeLibrary::Open(options_);
    if (!library.ok()) {
      disk_.Restart(SimulatedDisk::Loss::kEverything);
      return std::nullopt;
    }
    while (disk_.operations() <= n) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const std::uint64_t parses = (*library)->counters().parses;
    library->reset();
    disk_.Restart(SimulatedDisk::Loss::kEverything);
    return parses;
  }

  // Starts that begin the work on the mesh and end before it does, at every operation on the way
  // from the note to the work. Returns how many began it.
  std::uint32_t DieInResumedWork(std::uint32_t most) {
    std::uint32_t begun = RecordOnDisk().resumed;
    const std::uint32_t before = begun;
    for (std::uint64_t n = 0; n < 100 && begun - before < most; ++n) {
      const auto parses = StartAndDieAt(n);
      if (!parses) continue;
      const TreeRecord record = RecordOnDisk();
      EXPECT_FALSE(record.tree.has_value());
      if (record.resumed == begun) {
        EXPECT_EQ(*parses, 0u) << "the work began before it was noted, operation " << n;
      } else {
        EXPECT_EQ(record.resumed, ++begun);
        --n;  // and once more at the same operation
      }
    }
    return begun - before;
  }

  const std::vector<std::byte> mesh_ = SphereBytes(1);
  TreeId id_;
};

TEST_F(LibraryResumeTest, ABuildThatEndsTheProcessIsResumedByTwoStartsAndThenWaitsForARequest) {
  EXPECT_EQ(DieInResumedWork(2), 2u);
  for (int start = 0; start < 2; ++start) {
    Open();
    const auto trees = library_->List(std::nullopt, std::nullopt, 10);
    ASSERT_EQ(trees.size(), 1u);
    EXPECT_FALSE(trees[0].ready());
    EXPECT_EQ(trees[0].progress, 0);
    library_->Shutdown();
    EXPECT_EQ(library_->counters().parses, 0u);
    EXPECT_EQ(RecordOnDisk().resumed, 2u)
        << "a start in good order that did nothing proves nothing";
  }
  Open();
  const std::vector<core::Hit> answers = AnswersOf(library_.get(), id_);
  EXPECT_FALSE(answers.empty());
  Settle();
  EXPECT_EQ(RecordOnDisk().resumed, 0u);
  EXPECT_TRUE(RecordOnDisk().tree.has_value());
  EXPECT_EQ(RecordOnDisk().created_ms, 1'700'000'000'000);
}

TEST_F(LibraryResumeTest, ABuildThatWaitsForARequestBeginsWithAQuestionOrAnUpload) {
  TreeRecord record = RecordOnDisk();
  record.resumed = 2;
  for (const bool by_upload : {false, true}) {
    SaveAsCutOff(record);
    Open();
    if (by_upload) {
      const auto again = Upload(library_.get(), mesh_, BuildKind::kBvh);
      ASSERT_TRUE(again.ok());
      EXPECT_TRUE(again->existed);
    } else {
      ASSERT_TRUE(library_->Find(id_).ok());
    }
    library_->Wait(id_, Soon().deadline(), {}).value();
    EXPECT_EQ(library_->counters().builds, 1u);
    library_.reset();
    EXPECT_EQ(RecordOnDisk().resumed, 0u);
  }
}

TEST_F(LibraryResumeTest, AShutdownInGoodOrderIsNotCounted) {
  TreeRecord record = RecordOnDisk();
  record.mesh_bytes = SphereBytes(1, 100).size();
  for (std::uint32_t resumed = 0; resumed < 2; ++resumed) {
    library_.reset();
    Open();
    id_ = Upload(library_.get(), SphereBytes(1, 100), BuildKind::kKdSah)->id;
    (void)library_->Delete({record.id.mesh, BuildKind::kBvh});
    library_.reset();
    record.id = id_;
    record.resumed = resumed;
    SaveAsCutOff(record);
    Open();
    library_->Shutdown();
    const TreeRecord after = RecordOnDisk();
    EXPECT_EQ(after.resumed, after.tree ? 0u : resumed);
  }
}

TEST_F(LibraryResumeTest, OnADiskThatTakesNoNoteABuildBeginsOnlyOnceSomebodyAsks) {
  disk_.set_read_only(true);
  Open();
  library_->Shutdown();
  EXPECT_EQ(library_->counters().parses, 0u);
  Open();
  EXPECT_FALSE(AnswersOf(library_.get(), id_).empty());
  EXPECT_EQ(library_->counters().parses, 1u);
}

}  // namespace
}  // namespace kdray::test
