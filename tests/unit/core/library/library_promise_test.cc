// SPDX-License-Identifier: Apache-2.0
// What a library has answered holds after a restart, whatever the disk did meanwhile: lives with
// faults at random and all their restarts, against a model of what was promised.
#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "core/library/tree_library.h"
#include "tests/support/seed.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::ErrorCode;
using core::TreeId;
using core::TreeLibrary;

class LibraryPromiseTest : public LibraryTest {
 protected:
  LibraryPromiseTest() { Open(); }
  void Crash(SimulatedDisk::Loss loss = SimulatedDisk::Loss::kEverything) {
    library_.reset();
    disk_.Restart(loss);
    Open();
  }
};

TEST_F(LibraryPromiseTest, AnUploadAfterADeletionThatFailedIsThereAfterARestart) {
  const auto bytes = SphereBytes(1, 3);
  for (const auto loss : {SimulatedDisk::Loss::kNothing, SimulatedDisk::Loss::kContents,
                          SimulatedDisk::Loss::kEverything}) {
    for (std::uint64_t first = 0; first < 4; ++first) {
      const TreeId id = Add(bytes);
      Settle();
      disk_.DieAt(first);  // until it revives, whatever is tried fails
      const core::Status deleted = library_->Delete(id);
      disk_.Revive();
      if (deleted.ok()) continue;
      EXPECT_TRUE(library_->Find(id).ok()) << "an error: it is still there";
      const auto again = Upload(library_.get(), bytes);
      ASSERT_TRUE(again.ok());
      Crash(loss);
      EXPECT_TRUE(library_->Find(id).ok()) << "failed from operation " << first << " on";
      EXPECT_TRUE(library_->OpenMesh(id).ok());
    }
  }
}

TEST_F(LibraryPromiseTest, AnotherBuildAfterADeletionThatFailedIsThereAfterARestart) {
  const TreeId id = Add(SphereBytes(1, 3), BuildKind::kBvh);
  Settle();
  disk_.DieAt(1);
  EXPECT_FALSE(library_->Delete(id).ok());
  disk_.Revive();
  ASSERT_TRUE(library_->AddBuild(id.mesh, BuildKind::kBvh).ok());
  ASSERT_TRUE(library_->AddBuild(id.mesh, BuildKind::kBox).ok());
  Crash();
  EXPECT_TRUE(library_->Find(id).ok());
  EXPECT_TRUE(library_->Find({id.mesh, BuildKind::kBox}).ok());
}

TEST_F(LibraryPromiseTest, AnUploadRestoresWhatVanishedBehindTheLibrarysBack) {
  const auto bytes = SphereBytes(1, 3);
  const TreeId id = Add(bytes);
  const std::filesystem::path files[] = {
      std::filesystem::path("data/meshes") / id.mesh.ToHex(),
      std::filesystem::path("data/catalog") / id.ToString(),
  };
  for (const auto& file : files) {
    Settle();
    disk_.Erase(file);
    const auto again = Upload(library_.get(), bytes);
    ASSERT_TRUE(again.ok());
    EXPECT_TRUE(again->existed);
    Crash();
    EXPECT_TRUE(library_->Find(id).ok()) << file;
    EXPECT_TRUE(library_->OpenMesh(id).ok()) << file;
  }
}

TEST_F(LibraryPromiseTest, ABrokenMeshWhoseRecordStaysKeepsItsFileUntilBothCanGo) {
  const auto bytes = Bytes("hello, world, this is no mesh at all\n");
  // The disk takes the upload, and nothing after it.
  std::uint64_t operations = 0;
  {
    const std::uint64_t before = disk_.operations();
    ASSERT_TRUE(Upload(library_.get(), SphereBytes(1, 3)).ok());
    operations = disk_.operations() - before;
  }
  for (std::uint64_t n = 0; n <= operations + 10; ++n) {
    disk_.DieAt(n);
    const auto added = Upload(library_.get(), bytes);
    if (added.ok()) {
      EXPECT_FALSE(library_->Load(added->id, Soon()).ok());
    }
    Crash();
    const core::LibraryCounters counters = library_->counters();
    EXPECT_EQ(counters.unreadable_meshes, 0u) << "died at " << n;
    if (added.ok()) (void)library_->Load(added->id, Soon());
    (void)library_->Delete({DigestOf(bytes), std::nullopt});
  }
}

core::TradeoffOptions Quick() {
  core::TradeoffOptions options;
  options.rays = 64;
  options.runs = 1;
  options.trace_time = std::chrono::milliseconds(5);
  return options;
}

TEST_F(LibraryPromiseTest, WhatWasMeasuredIsThereAfterARestartAndWhatWasForgottenIsNot) {
  const TreeId id = Add(SphereBytes(1, 3));
  const auto measured = [&] {
    const auto info = library_->WaitForMeasured(
        id, std::chrono::steady_clock::now() + std::chrono::minutes(1), Soon());
    return info.ok() && info->has_value() && (*info)->measured.has_value();
  };
  ASSERT_TRUE(library_->Measure(id, Quick()).ok());
  ASSERT_TRUE(measured());
  Crash();
  EXPECT_TRUE(measured()) << "it was answered, so it was stored";
  for (std::uint64_t n = 0; n < 3; ++n) {
    disk_.FailAt(n, ErrorCode::kIo);
    const auto forgotten = library_->ForgetMeasured(id);
    if (forgotten.ok()) break;
    EXPECT_EQ(forgotten.error().code, ErrorCode::kIo);
  }
  EXPECT_FALSE(measured());
  Crash();
  EXPECT_FALSE(measured());
}

// What is known of an id: it must be there, must not, or an answer left it open.
enum class Promise { kAbsent, kPresent, kOpen };

class Model {
 public:
  explicit Model(std::uint64_t seed) : random_(RandomEngine(seed)) {
    options_.data_dir = "data";
    options_.file_system = &disk_;
    const auto orphan = SphereBytes(50, 3);
    kept_.emplace_back(std::filesystem::path("data/meshes") / DigestOf(orphan).ToHex(), orphan);
    for (const char* folder : {"meshes", "catalog", "parsed", "trees", "measured"}) {
      kept_.emplace_back(std::filesystem::path("data") / folder / "README", Bytes("junk"));
    }
  }

  void Live(int lives) {
    Start();
    for (const auto& [path, contents] : kept_) disk_.SetContents(path, contents);
    for (int life = 0; life < lives && !testing::Test::HasFailure(); ++life) {
      for (int step = 0; step < 12; ++step) Act();
      End();
      MeetAnAdministrator();
      Start();
      Check();
    }
  }

 private:
  std::uint64_t Below(std::uint64_t end) { return random_() % end; }

  void Note(const std::string& line) { story_ += line + "\n"; }

  void Start() {
    auto library = TreeLibrary::Open(options_);
    ASSERT_TRUE(library.ok()) << library.error().message << "\n" << story_;
    library_ = *std::move(library);
  }
  void End() {
    library_.reset();
    disk_.Restart(static_cast<SimulatedDisk::Loss>(Below(3)));
    Note("restart");
  }

  void BreakTheDisk() {
    constexpr ErrorCode kCodes[] = {ErrorCode::kIo, ErrorCode::kStoreFull};
    const std::uint64_t n = Below(12);
    switch (Below(4)) {
      case 0:
        Note("fails once at " + std::to_string(n));
        disk_.FailAt(n, kCodes[Below(2)]);
        break;
      case 1:
        Note("fails from " + std::to_string(n) + " on");
        disk_.DieAt(n);
        break;
      case 2:
        disk_.Revive();
        break;
      default:
        break;
    }
  }

  void Act() {
    // Few of them, so that one fault meets the next.
    const auto bytes = SphereBytes(static_cast<int>(Below(2)), 3);
    const std::optional<BuildKind> builds[] = {std::nullopt, BuildKind::kBox};
    const TreeId id{DigestOf(bytes), builds[Below(2)]};
    Promise& promise = promises_[id];
    BreakTheDisk();
    const std::uint64_t action = Below(6);
    if (action <= 1) {
      const auto added = Upload(library_.get(), bytes, id.build);
      Note((added.ok() ? "uploaded " : "failed to upload ") + id.ToString());
      promise = added.ok()                    ? Promise::kPresent
                : promise == Promise::kAbsent ? Promise::kOpen
                                              : promise;
    } else if (action == 2) {
      const auto added = library_->AddBuild(id.mesh, id.build);
      Note((added.ok() ? "added " : "failed to add ") + id.ToString());
      promise = added.ok()                    ? Promise::kPresent
                : promise == Promise::kAbsent ? Promise::kOpen
                                              : promise;
    } else if (action == 3) {
      const core::Status deleted = library_->Delete(id);
      Note((deleted.ok() ? "deleted " : "failed to delete ") + id.ToString());
      if (deleted.ok()) {
        promise = Promise::kAbsent;
      } else if (deleted.error().code != ErrorCode::kNotFound && promise == Promise::kPresent) {
        promise = Promise::kOpen;
      }
    } else if (action == 4) {
      (void)library_->Load(id, Within(std::chrono::seconds(5)));
    } else {
      (void)library_->OpenMesh(id);
    }
  }

  // Who does something to a folder, sees a start, and takes it back.
  void MeetAnAdministrator() {
    constexpr const char* kFolders[] = {"meshes", "catalog", "parsed", "trees", "measured"};
    const auto folder = std::filesystem::path("data") / kFolders[Below(5)];
    std::function<void()> undo;
    switch (Below(5)) {
      case 0:
        disk_.GiveAway(folder);
        undo = [&] { disk_.TakeBack(folder); };
        break;
      case 1:
        disk_.Unmount(folder, SimulatedDisk::Absence::kMissing);
        undo = [&] { disk_.Mount(folder); };
        break;
      case 2:
        disk_.Unmount(folder, SimulatedDisk::Absence::kEmpty);
        undo = [&] { disk_.Mount(folder); };
        break;
      case 3:
        disk_.SetAccess(folder, SimulatedDisk::Access::kNothing);
        undo = [&] { disk_.SetAccess(folder, SimulatedDisk::Access::kAll); };
        break;
      default:
        return;
    }
    Note("something happens to " + folder.string());
    const auto before = disk_.AllFiles();
    {
      const auto library = TreeLibrary::Open(options_);
      if (!library.ok()) {
        EXPECT_EQ(disk_.AllFiles(), before) << story_;
      }
    }
    undo();
  }

  void Check() {
    for (auto& [id, promise] : promises_) {
      const bool is_there = library_->Find(id).ok();
      if (promise != Promise::kOpen) {
        EXPECT_EQ(is_there, promise == Promise::kPresent) << id.ToString() << "\n" << story_;
      }
      promise = is_there ? Promise::kPresent : Promise::kAbsent;
      if (!is_there) continue;
      EXPECT_TRUE(library_->OpenMesh(id).ok()) << id.ToString() << "\n" << story_;
      EXPECT_TRUE(library_->Load(id, Soon()).ok()) << id.ToString() << "\n" << story_;
    }
    for (const auto& [path, contents] : kept_) {
      EXPECT_EQ(disk_.Contents(path), contents) << path << "\n" << story_;
    }
    EXPECT_EQ(library_->counters().unreadable_meshes, 0u) << story_;
  }

  std::mt19937_64 random_;
  SimulatedDisk disk_;
  core::LibraryOptions options_;
  std::unique_ptr<TreeLibrary> library_;
  std::map<TreeId, Promise> promises_;
  std::vector<std::pair<std::filesystem::path, std::vector<std::byte>>> kept_;
  std::string story_;
};

TEST(LibraryPromise, WhatWasAnsweredHoldsAfterEveryRestartWhateverTheDiskDid) {
  for (std::uint64_t seed = 0; seed < 200 && !testing::Test::HasFailure(); ++seed) {
    Model(7000 + seed).Live(4);
  }
}

}  // namespace
}  // namespace kdray::test
