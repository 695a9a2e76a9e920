// SPDX-License-Identifier: Apache-2.0
// What a TreeLibrary does about damaged files, full and read-only disks.
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "core/library/tree_library.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::ErrorCode;
using core::Hit;
using core::TreeId;
using core::TreeLibrary;
using std::chrono::steady_clock;

class LibraryDiskTest : public LibraryTest {
 protected:
  LibraryDiskTest() { Open(); }

  std::filesystem::path FileOf(const char* folder, const TreeId& id) const {
    const bool by_tree = std::string(folder) == "trees" || std::string(folder) == "catalog";
    return std::filesystem::path("data") / folder / (by_tree ? id.ToString() : id.mesh.ToHex());
  }
};

TEST_F(LibraryDiskTest, AfterARestartEverythingIsThereAndNothingIsBuilt) {
  std::map<TreeId, std::vector<Hit>> answers;
  std::map<TreeId, core::TreeRecord> records;
  for (const BuildKind build : core::kAllBuildKinds) {
    const TreeId id = Add(SphereBytes(1), build);
    answers[id] = AnswersOf(library_.get(), id);
  }
  const TreeId automatic = Add(SphereBytes(2));
  answers[automatic] = AnswersOf(library_.get(), automatic);
  for (const auto& [id, hits] : answers) records[id] = library_->Find(id)->record;
  Settle();
  EXPECT_EQ(library_->counters().trees, 7u);
  for (const auto& [id, hits] : answers) {
    const auto info = library_->Find(id);
    ASSERT_TRUE(info.ok());
    EXPECT_TRUE(info->ready()) << "at once";
    EXPECT_EQ(info->record, records[id]) << "creation time included";
    EXPECT_EQ(AnswersOf(library_.get(), id), hits);
  }
  const core::LibraryCounters counters = library_->counters();
  EXPECT_EQ(counters.builds, 0u);
  EXPECT_EQ(counters.parses, 0u);
  EXPECT_EQ(counters.loads, 7u);
  EXPECT_EQ(counters.damaged_files, 0u);
}

TEST_F(LibraryDiskTest, TheSameOnTheRealDisk) {
  const TemporaryFolder folder;
  options_.file_system = nullptr;
  options_.data_dir = folder.path() / "data";
  Open();
  const TreeId id = Add(SphereBytes(1));
  const std::vector<Hit> answers = AnswersOf(library_.get(), id);
  Settle();
  EXPECT_EQ(AnswersOf(library_.get(), id), answers);
  EXPECT_EQ(library_->counters().builds, 0u);
  const auto second = TreeLibrary::Open(options_);
  ASSERT_FALSE(second.ok()) << "while this one has the folder";
  EXPECT_EQ(second.error().code, ErrorCode::kInvalidArgument);
}

TEST_F(LibraryDiskTest, ADamagedDerivedFileIsNoticedMadeAgainAndCounted) {
  const TreeId id = Add(SphereBytes(1), BuildKind::kKdSah);
  const TreeId other = Add(SphereBytes(2), BuildKind::kKdSah);
  const std::vector<Hit> expected = AnswersOf(library_.get(), id);
  Settle();
  struct Damage {
    const char* what;
    std::function<void(const std::filesystem::path&, const std::filesystem::path&)> apply;
    bool is_counted;
  };
  const Damage damages[] = {
      {"flipped",
       [&](const auto& path, const auto&) {
         auto bytes = disk_.Contents(path).value();
         bytes[bytes.size() / 2] ^= std::byte{4};
         disk_.SetContents(path, bytes);
       },
       true},
      {"cut",
       [&](const auto& path, const auto&) {
         auto bytes = disk_.Contents(path).value();
         bytes.resize(bytes.size() - 1);
         disk_.SetContents(path, bytes);
       },
       true},
      {"emptied", [&](const auto& path, const auto&) { disk_.SetContents(path, {}); }, true},
      {"grown",
       [&](const auto& path, const auto&) {
         auto bytes = disk_.Contents(path).value();
         bytes.push_back(std::byte{0});
         disk_.SetContents(path, bytes);
       },
       true},
      {"swapped",
       [&](const auto& path, const auto& of_other) {
         disk_.SetContents(path, disk_.Contents(of_other).value());
       },
       true},
      {"a link", [&](const auto& path, const auto&) { disk_.MakeUnreadable(path); }, true},
      {"lost", [&](const auto& path, const auto&) { disk_.Erase(path); }, false},
  };
  for (const char* folder : {"parsed", "trees"}) {
    for (const Damage& damage : damages) {
      for (const bool while_running : {false, true}) {
        const std::string what = std::string(folder) + " file " + damage.what;
        library_->Shutdown();
        if (while_running) Open();
        damage.apply(FileOf(folder, id), FileOf(folder, other));
        if (!while_running) Open();
        EXPECT_EQ(AnswersOf(library_.get(), id), expected) << what;
        core::LibraryCounters counters = library_->counters();
        EXPECT_EQ(counters.damaged_files, damage.is_counted ? 1u : 0u) << what;
        const bool tree = std::string(folder) == "trees";
        EXPECT_EQ(counters.builds, tree ? 1u : 0u) << what;
        EXPECT_EQ(counters.rebuilds, tree ? 1u : 0u) << what;
        EXPECT_EQ(counters.parses, tree ? 0u : 1u) << what;
        Settle();
        EXPECT_EQ(AnswersOf(library_.get(), id), expected) << what;
        counters = library_->counters();
        EXPECT_EQ(counters.builds + counters.parses + counters.damaged_files, 0u)
            << what << ": made again on disk as well";
      }
    }
  }
}

TEST_F(LibraryDiskTest, ADamagedCatalogEntryCostsOneTreeItsDescriptionUntilItIsReadAgain) {
  const TreeId id = Add(SphereBytes(1), BuildKind::kKdSah);
  const std::vector<Hit> expected = AnswersOf(library_.get(), id);
  Settle();
  library_->Shutdown();
  disk_.SetContents(FileOf("catalog", id), Bytes("junk"));
  Open();
  EXPECT_EQ(AnswersOf(library_.get(), id), expected);
  EXPECT_EQ(library_->counters().damaged_files, 1u);
  EXPECT_EQ(library_->counters().builds, 0u) << "the derived files are still good";
  EXPECT_EQ(library_->counters().parses, 0u);
  EXPECT_TRUE(library_->Find(id)->ready());
  Settle();
  EXPECT_EQ(library_->counters().damaged_files, 0u);
}

TEST_F(LibraryDiskTest, DamagedMeshBytesAreNeverServedAndAnUploadRepairsThem) {
  const auto bytes = SphereBytes(1);
  const TreeId id = Add(bytes);
  const std::vector<Hit> expected = AnswersOf(library_.get(), id);
  Settle();
  for (const bool lost : {false, true}) {
    if (lost) {
      disk_.Erase(FileOf("meshes", id));
    } else {
      auto bad = bytes;
      bad[bad.size() / 2] ^= std::byte{1};
      disk_.SetContents(FileOf("meshes", id), bad);
    }
    const auto damaged = library_->OpenMesh(id);
    ASSERT_FALSE(damaged.ok());
    EXPECT_EQ(damaged.error().code, ErrorCode::kCorrupt);
    EXPECT_EQ(AnswersOf(library_.get(), id), expected) << "the parsed mesh is good";
    const auto again = Upload(library_.get(), bytes);
    ASSERT_TRUE(again.ok());
    EXPECT_TRUE(again->existed);
    EXPECT_TRUE(library_->OpenMesh(id).ok());
    EXPECT_EQ(disk_.Contents(FileOf("meshes", id)).value(), bytes);
  }
}

TEST_F(LibraryDiskTest, WithNothingButDamagedFilesTheMeshIsKeptAndAnUploadRepairsIt) {
  const auto bytes = SphereBytes(1);
  const TreeId id = Add(bytes);
  const std::vector<Hit> expected = AnswersOf(library_.get(), id);
  Settle();
  library_->Shutdown();
  for (const char* folder : {"meshes", "parsed"}) {
    auto bad = disk_.Contents(FileOf(folder, id)).value();
    bad[bad.size() / 2] ^= std::byte{1};
    disk_.SetContents(FileOf(folder, id), bad);
  }
  Open();
  const auto loaded = library_->Load(id, Soon());
  ASSERT_FALSE(loaded.ok());
  EXPECT_EQ(loaded.error().code, ErrorCode::kCorrupt);
  EXPECT_TRUE(library_->Find(id)->ready());
  ASSERT_TRUE(Upload(library_.get(), bytes).ok());
  EXPECT_EQ(AnswersOf(library_.get(), id), expected);
}

TEST_F(LibraryDiskTest, JunkInTheDataDirectoryIsLeftAlone) {
  const TreeId id = Add(SphereBytes(1));
  const std::vector<Hit> expected = AnswersOf(library_.get(), id);
  Settle();
  library_->Shutdown();
  const std::filesystem::path data = "data";
  std::vector<std::filesystem::path> junk;
  for (const char* folder : {"meshes", "parsed", "trees", "catalog"}) {
    for (const char* name : {"README", "core.1234", "lost+found", "..", "0"}) {
      if (std::string(name) != "..") junk.push_back(data / folder / name);
    }
    junk.push_back(data / folder / (id.mesh.ToHex() + ".bak"));
  }
  for (const auto& path : junk) disk_.SetContents(path, Bytes("junk"));
  // A mesh that no record names stays with what was derived from it; what was derived from nothing
  // goes, and a record stays although its mesh is lost.
  const std::string orphan = DigestOf(Bytes("orphan")).ToHex();
  const std::string nothing = DigestOf(Bytes("nothing")).ToHex();
  disk_.SetContents(data / "meshes" / orphan, Bytes("orphan"));
  for (const std::string& mesh : {orphan, nothing}) {
    disk_.SetContents(data / "parsed" / mesh, Bytes("junk"));
    disk_.SetContents(data / "trees" / (mesh + "-bvh"), Bytes("junk"));
  }
  disk_.SetContents(data / "catalog" / (DigestOf(Bytes("gone")).ToHex() + "-bvh"), Bytes("x"));
  Open();
  EXPECT_EQ(library_->counters().trees, 2u);
  EXPECT_EQ(AnswersOf(library_.get(), id), expected);
  for (const auto& path : junk) EXPECT_TRUE(disk_.Contents(path).has_value()) << path;
  EXPECT_TRUE(disk_.Contents(data / "meshes" / orphan).has_value());
  EXPECT_TRUE(disk_.Contents(data / "parsed" / orphan).has_value());
  EXPECT_TRUE(disk_.Contents(data / "trees" / (orphan + "-bvh")).has_value());
  EXPECT_FALSE(disk_.Contents(data / "parsed" / nothing).has_value());
  EXPECT_FALSE(disk_.Contents(data / "trees" / (nothing + "-bvh")).has_value());
  EXPECT_EQ(FilesIn("catalog"), 7u);
}

TEST_F(LibraryDiskTest, ABuildThatWasCutOffResumes) {
  const auto bytes = SphereBytes(1);
  const TreeId id = Add(bytes, BuildKind::kBvh);
  const std::vector<Hit> expected = AnswersOf(library_.get(), id);
  Settle();
  library_->Shutdown();
  // As a crash before the first build would have left it.
  core::Catalog catalog(&disk_, "data/catalog");
  core::TreeRecord record;
  record.id = id;
  record.created_ms = 1'700'000'000'000;
  record.mesh_bytes = bytes.size();
  ASSERT_TRUE(catalog.Save(record).ok());
  disk_.Erase(FileOf("parsed", id));
  disk_.Erase(FileOf("trees", id));
  Open();
  const auto info =
      library_->Wait(id, steady_clock::now() + std::chrono::minutes(2), core::CancelToken());
  ASSERT_TRUE(info.ok());
  EXPECT_TRUE(info->ready()) << "without a query or an upload";
  EXPECT_EQ(info->record.created_ms, 1'700'000'000'000);
  EXPECT_EQ(library_->counters().builds, 1u);
  EXPECT_EQ(AnswersOf(library_.get(), id), expected);
}

TEST_F(LibraryDiskTest, AReadOnlyDiskStillServesAndTakesNoUploads) {
  const TreeId in_memory = Add(SphereBytes(1));
  const TreeId on_disk = Add(SphereBytes(2));
  const std::vector<Hit> a = AnswersOf(library_.get(), in_memory);
  const std::vector<Hit> b = AnswersOf(library_.get(), on_disk);
  Settle();
  EXPECT_EQ(AnswersOf(library_.get(), in_memory), a);
  disk_.set_read_only(true);
  EXPECT_EQ(AnswersOf(library_.get(), in_memory), a);
  EXPECT_EQ(AnswersOf(library_.get(), on_disk), b);
  const auto upload = library_->BeginUpload(1000);
  ASSERT_FALSE(upload.ok());
  EXPECT_EQ(upload.error().code, ErrorCode::kStoreFull);
  EXPECT_EQ(library_->AddBuild(in_memory.mesh, BuildKind::kBvh).error().code,
            ErrorCode::kStoreFull);
  EXPECT_EQ(library_->Delete(in_memory).error().code, ErrorCode::kStoreFull);
  EXPECT_EQ(AnswersOf(library_.get(), in_memory), a) << "not deleted";
  Open();
  EXPECT_EQ(AnswersOf(library_.get(), on_disk), b) << "it even starts";
  disk_.set_read_only(false);
  EXPECT_TRUE(Upload(library_.get(), SphereBytes(3)).ok());
  EXPECT_TRUE(library_->Delete(in_memory).ok());
}

TEST_F(LibraryDiskTest, AFullDiskStillServesAndGivesUpDerivedFilesForUploads) {
  const TreeId id = Add(SphereBytes(1, 20), BuildKind::kKdSah);
  const std::vector<Hit> expected = AnswersOf(library_.get(), id);
  Settle();
  std::uint64_t used = 0;
  for (const char* folder : {"meshes", "parsed", "trees", "catalog"}) {
    for (const auto& name : disk_.FilesIn(std::filesystem::path("data") / folder)) {
      used += disk_.Contents(std::filesystem::path("data") / folder / name)->size();
    }
  }
  disk_.set_capacity(used + 200);
  const auto upload = Upload(library_.get(), SphereBytes(2, 8), BuildKind::kBox);
  ASSERT_TRUE(upload.ok()) << upload.error().message;
  EXPECT_FALSE(disk_.Contents(FileOf("trees", id)).has_value());
  EXPECT_TRUE(disk_.Contents(FileOf("meshes", id)).has_value()) << "meshes stay";
  EXPECT_TRUE(library_->Load(upload->id, Soon()).ok());
  EXPECT_EQ(AnswersOf(library_.get(), id), expected);

  Settle();
  disk_.set_capacity(0);
  const auto refused = Upload(library_.get(), SphereBytes(3));
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::kStoreFull);
  const auto at_the_door = library_->BeginUpload(1000);
  ASSERT_FALSE(at_the_door.ok()) << "no derived file is left to give up";
  EXPECT_EQ(at_the_door.error().code, ErrorCode::kStoreFull);
  EXPECT_EQ(AnswersOf(library_.get(), id), expected) << "built again, kept in memory only";
}

TEST_F(LibraryDiskTest, ADiskThatFillsUpDuringAnUploadRefusesIt) {
  const auto bytes = SphereBytes(1);
  auto upload = library_->BeginUpload(bytes.size());
  ASSERT_TRUE(upload.ok());
  disk_.set_capacity(100);
  const core::Status status = upload->Append(bytes);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, ErrorCode::kStoreFull);
}

}  // namespace
}  // namespace kdray::test
