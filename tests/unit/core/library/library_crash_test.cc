// SPDX-License-Identifier: Apache-2.0
// What is left of a TreeLibrary's work after crashes and failures at every operation of its disk.
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "core/library/tree_library.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::ErrorCode;
using core::Hit;
using core::TreeId;
using core::TreeLibrary;

// A day in a library's life, as far as the disk lets it: what was answered, and with what.
struct Day {
  std::vector<TreeId> acknowledged;
  std::vector<TreeId> deleted;
  std::vector<TreeId> not_deleted;  // the answer was an error
};

Day LiveThrough(TreeLibrary* library) {
  Day day;
  const auto upload = [&](int number, std::optional<BuildKind> build) {
    const auto added = Upload(library, SphereBytes(number, 3), build);
    if (!added.ok()) return;
    day.acknowledged.push_back(added->id);
    (void)library->Load(added->id, Soon());
  };
  upload(1, std::nullopt);
  upload(2, BuildKind::kBvh);
  upload(1, BuildKind::kBox);
  for (const TreeId& id : std::vector<TreeId>(day.acknowledged)) {
    if (id.build != BuildKind::kBvh) continue;
    std::erase(day.acknowledged, id);
    (library->Delete(id).ok() ? day.deleted : day.not_deleted).push_back(id);
  }
  upload(3, BuildKind::kKdBinned);
  return day;
}

class Calendar {
 public:
  Calendar() {
    options_.data_dir = "data";
    for (int number = 1; number <= 3; ++number) {
      SimulatedDisk disk;
      options_.file_system = &disk;
      auto library = TreeLibrary::Open(options_);
      const auto added = Upload(library->get(), SphereBytes(number, 3), BuildKind::kBox);
      expected_[added->id.mesh] = AnswersOf(library->get(), added->id);
    }
  }

  // Lives through a day with a fault that `break_disk` arranges, and looks what is left of it.
  void Run(const std::function<void(SimulatedDisk*)>& break_disk, SimulatedDisk::Loss loss,
           bool dies, const std::string& what) {
    SimulatedDisk disk;
    options_.file_system = &disk;
    auto library = TreeLibrary::Open(options_);
    ASSERT_TRUE(library.ok());
    break_disk(&disk);
    Day day = LiveThrough(library->get());
    // A process that ended during a deletion may have done it; one that goes on has not.
    if (!dies) {
      day.acknowledged.insert(day.acknowledged.end(), day.not_deleted.begin(),
                              day.not_deleted.end());
    }
    library->reset();
    disk.Restart(loss);

    library = TreeLibrary::Open(options_);
    ASSERT_TRUE(library.ok()) << what;
    for (const TreeId& id : day.acknowledged) {
      EXPECT_EQ(AnswersOf(library->get(), id), expected_[id.mesh]) << what << ": " << id.ToString();
      const auto mesh = (*library)->OpenMesh(id);
      EXPECT_TRUE(mesh.ok()) << what << ": " << id.ToString();
    }
    for (const TreeId& id : day.deleted) {
      EXPECT_FALSE((*library)->Find(id).ok()) << what << ": " << id.ToString();
    }
    for (const core::TreeInfo& info : (*library)->List(std::nullopt, std::nullopt, 100)) {
      EXPECT_EQ(AnswersOf(library->get(), info.record.id), expected_[info.record.id.mesh]) << what;
    }
    library->reset();  // it may be writing yet
    for (const char* folder : {"meshes", "parsed", "trees", "catalog"}) {
      for (const std::string& name : disk.FilesIn(std::filesystem::path("data") / folder)) {
        EXPECT_FALSE(name.starts_with('.')) << what << ": " << folder << "/" << name;
      }
    }
  }

  std::uint64_t OperationsOfADay() {
    SimulatedDisk disk;
    options_.file_system = &disk;
    auto library = TreeLibrary::Open(options_);
    const std::uint64_t before = disk.operations();
    (void)LiveThrough(library->get());
    library->reset();
    return disk.operations() - before;
  }

 private:
  core::LibraryOptions options_;
  std::map<core::Sha256Digest, std::vector<Hit>> expected_;
};

TEST(LibraryCrash, NothingThatWasAnsweredIsLostWhereverItDies) {
  Calendar calendar;
  const std::uint64_t operations = calendar.OperationsOfADay();
  ASSERT_GT(operations, 60u);
  for (const auto loss : {SimulatedDisk::Loss::kNothing, SimulatedDisk::Loss::kContents,
                          SimulatedDisk::Loss::kEverything}) {
    for (std::uint64_t n = 0; n <= operations; ++n) {
      calendar.Run([n](SimulatedDisk* disk) { disk->DieAt(n); }, loss, true,
                   "died at operation " + std::to_string(n) + ", loss " +
                       std::to_string(static_cast<int>(loss)));
      if (testing::Test::HasFailure()) return;
    }
  }
}

TEST(LibraryCrash, NoAnswerIsWrongWhicheverOperationFailsOnce) {
  Calendar calendar;
  const std::uint64_t operations = calendar.OperationsOfADay();
  for (const ErrorCode code : {ErrorCode::kIo, ErrorCode::kStoreFull, ErrorCode::kNotFound}) {
    for (std::uint64_t n = 0; n <= operations; ++n) {
      calendar.Run([n, code](SimulatedDisk* disk) { disk->FailAt(n, code); },
                   SimulatedDisk::Loss::kEverything, false,
                   "failed at operation " + std::to_string(n) + " with " +
                       std::to_string(static_cast<int>(code)));
      if (testing::Test::HasFailure()) return;
    }
  }
}

}  // namespace
}  // namespace kdray::test
