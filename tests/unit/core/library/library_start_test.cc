// SPDX-License-Identifier: Apache-2.0
// What a start makes of a data directory that is not as it was left: another owner, a disk that is
// not mounted, links, meshes without records and records without meshes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
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
using testing::HasSubstr;

constexpr const char* kFolders[] = {"meshes", "catalog", "parsed", "trees", "measured"};

std::filesystem::path FolderOf(const char* name) { return std::filesystem::path("data") / name; }

class LibraryStartTest : public LibraryTest {
 protected:
  LibraryStartTest() { Open(); }

  void Fill(int meshes) {
    for (int number = 1; number <= meshes; ++number) {
      const TreeId id = Add(SphereBytes(number, 3));
      answers_[id] = AnswersOf(library_.get(), id);
    }
    Settle();
    library_.reset();
    // As a crash leaves it: a refused start does not even remove this.
    disk_.SetContents("data/meshes/.new-1-1", Bytes("half"));
  }
  std::filesystem::path MeshFile(const TreeId& id) const {
    return FolderOf("meshes") / id.mesh.ToHex();
  }
  /// The start fails, says why, and changes nothing.
  void ExpectRefused(const std::string& why) {
    library_.reset();
    const auto before = disk_.AllFiles();
    const auto library = TreeLibrary::Open(options_);
    ASSERT_FALSE(library.ok()) << why;
    EXPECT_EQ(library.error().code, ErrorCode::kCorrupt) << library.error().message;
    EXPECT_THAT(library.error().message, HasSubstr(why));
    EXPECT_EQ(library.error().message.find('\n'), std::string::npos);
    EXPECT_EQ(disk_.AllFiles(), before) << why;
  }
  void ExpectAllThere() {
    Open();
    EXPECT_EQ(library_->counters().trees, answers_.size());
    for (const auto& [id, hits] : answers_) {
      EXPECT_EQ(AnswersOf(library_.get(), id), hits);
      EXPECT_TRUE(library_->OpenMesh(id).ok());
    }
  }

  std::map<TreeId, std::vector<Hit>> answers_;
};

TEST_F(LibraryStartTest, AFolderOfAnotherUserRefusesTheStartAndLosesNothing) {
  Fill(3);
  for (const char* folder : kFolders) {
    disk_.GiveAway(FolderOf(folder));
    ExpectRefused(std::string("folder ") + folder + " belongs to user");
    disk_.TakeBack(FolderOf(folder));
  }
  for (const char* folder : kFolders) disk_.GiveAway(FolderOf(folder));
  ExpectRefused("belongs to user");
  for (const char* folder : kFolders) disk_.TakeBack(FolderOf(folder));
  ExpectAllThere();
}

TEST_F(LibraryStartTest, AFolderThatIsMissingRefusesTheStartEvenForOneMesh) {
  for (const int meshes : {1, 3}) {
    Fill(meshes);
    for (const char* folder : kFolders) {
      disk_.Unmount(FolderOf(folder), SimulatedDisk::Absence::kMissing);
      ExpectRefused(std::string("folder ") + folder + " is missing");
      disk_.Mount(FolderOf(folder));
    }
    ExpectAllThere();
  }
}

TEST_F(LibraryStartTest, AMountPointWithoutItsDiskRefusesTheStart) {
  Fill(3);
  disk_.Unmount(FolderOf("meshes"), SimulatedDisk::Absence::kEmpty);
  ExpectRefused("3 of 3 recorded meshes cannot be read");
  disk_.Mount(FolderOf("meshes"));
  ExpectAllThere();
}

TEST_F(LibraryStartTest, AFolderThatCannotBeReadRefusesTheStart) {
  Fill(3);
  for (const char* folder : kFolders) {
    disk_.SetAccess(FolderOf(folder), SimulatedDisk::Access::kNothing);
    ExpectRefused(folder);
    disk_.SetAccess(FolderOf(folder), SimulatedDisk::Access::kAll);
  }
  ExpectAllThere();
}

TEST_F(LibraryStartTest, WithoutItsCatalogMeshesAreKeptAndServeNobody) {
  Fill(3);
  disk_.Unmount(FolderOf("catalog"), SimulatedDisk::Absence::kEmpty);
  Open();
  EXPECT_EQ(library_->counters().trees, 0u);
  EXPECT_EQ(library_->counters().unrecorded_meshes, 3u);
  library_.reset();
  disk_.Mount(FolderOf("catalog"));
  ExpectAllThere();
  EXPECT_EQ(library_->counters().builds + library_->counters().parses, 0u)
      << "derived files were kept as well";
}

TEST_F(LibraryStartTest, MostMeshesUnreadableRefuseTheStartAFewDoNot) {
  Fill(4);
  std::vector<TreeId> ids;
  for (const auto& [id, hits] : answers_) ids.push_back(id);
  const std::pair<const char*, std::function<void(const std::filesystem::path&)>> damages[] = {
      {"foreign", [&](const auto& file) { disk_.MakeUnreadable(file); }},
      {"lost", [&](const auto& file) { disk_.Erase(file); }},
      {"cut",
       [&](const auto& file) {
         auto bytes = *disk_.Contents(file);
         bytes.pop_back();
         disk_.SetContents(file, bytes);
       }},
  };
  for (const auto& [what, damage] : damages) {
    std::map<TreeId, std::vector<std::byte>> bytes;
    for (const TreeId& id : ids) bytes[id] = *disk_.Contents(MeshFile(id));
    for (std::size_t count = 1; count <= ids.size(); ++count) {
      damage(MeshFile(ids[count - 1]));
      if (count > 2) {
        ExpectRefused(std::to_string(count) + " of 4 recorded meshes cannot be read");
        continue;
      }
      Open();
      EXPECT_EQ(library_->counters().trees, 4u) << what;
      EXPECT_EQ(library_->counters().unreadable_meshes, count) << what;
      for (std::size_t i = 0; i < ids.size(); ++i) {
        const auto mesh = library_->OpenMesh(ids[i]);
        EXPECT_EQ(mesh.ok(), i >= count) << what;
        EXPECT_TRUE(mesh.ok() || mesh.error().code == ErrorCode::kCorrupt) << what;
      }
      library_.reset();
    }
    for (const TreeId& id : ids) disk_.SetContents(MeshFile(id), bytes[id]);
    ExpectAllThere();
    library_.reset();
  }
}

TEST_F(LibraryStartTest, MostRecordsUnreadableRefuseTheStart) {
  Fill(3);
  const auto first = answers_.begin()->first;
  const auto second = std::next(answers_.begin())->first;
  disk_.MakeUnreadable(FolderOf("catalog") / first.ToString());
  disk_.MakeUnreadable(FolderOf("catalog") / second.ToString());
  ExpectRefused("2 of 3 records");
  disk_.MakeReadable(FolderOf("catalog") / first.ToString());
  ExpectAllThere();
}

TEST_F(LibraryStartTest, ADamagedRecordIsMadeAgainWithTheSizeOfItsMesh) {
  Fill(2);
  for (const auto& [id, hits] : answers_) {
    disk_.SetContents(FolderOf("catalog") / id.ToString(), Bytes("damaged"));
  }
  ExpectAllThere();
  for (const auto& [id, hits] : answers_) {
    const auto info = library_->Find(id);
    ASSERT_TRUE(info.ok());
    EXPECT_EQ(info->record.mesh_bytes, disk_.Contents(MeshFile(id))->size());
  }
}

TEST_F(LibraryStartTest, ATreeWhoseMeshIsGoneStaysAndSaysSoUntilAnUploadRepairsIt) {
  Fill(1);
  const TreeId id = answers_.begin()->first;
  disk_.Erase(MeshFile(id));
  disk_.Erase(FolderOf("parsed") / id.mesh.ToHex());
  for (int start = 0; start < 2; ++start) {
    Open();
    EXPECT_TRUE(library_->Find(id).ok());
    const auto loaded = library_->Load(id, Soon());
    ASSERT_FALSE(loaded.ok());
    EXPECT_EQ(loaded.error().code, ErrorCode::kCorrupt);
    EXPECT_EQ(library_->OpenMesh(id).error().code, ErrorCode::kCorrupt);
    EXPECT_EQ(FilesIn("catalog"), 1u);
  }
  ASSERT_TRUE(Upload(library_.get(), SphereBytes(1, 3)).ok());
  EXPECT_EQ(library_->counters().unreadable_meshes, 0u);
  ExpectAllThere();
}

TEST_F(LibraryStartTest, AMeshWithoutARecordIsKeptCountedAndTakenInByAnUpload) {
  Fill(2);
  const auto bytes = SphereBytes(9, 3);
  const std::filesystem::path file = FolderOf("meshes") / DigestOf(bytes).ToHex();
  disk_.SetContents(file, bytes);
  for (int start = 0; start < 2; ++start) {
    ExpectAllThere();
    EXPECT_EQ(disk_.Contents(file), bytes);
    EXPECT_EQ(library_->counters().unrecorded_meshes, 1u);
    EXPECT_EQ(library_->AddBuild(DigestOf(bytes), std::nullopt).error().code, ErrorCode::kNotFound);
  }
  const auto added = Upload(library_.get(), bytes);
  ASSERT_TRUE(added.ok());
  EXPECT_FALSE(added->existed);
  EXPECT_EQ(library_->counters().unrecorded_meshes, 0u);
  EXPECT_TRUE(library_->Load(added->id, Soon()).ok());
  Open();
  EXPECT_EQ(library_->counters().trees, 3u);
  EXPECT_EQ(library_->counters().unrecorded_meshes, 0u);
}

TEST_F(LibraryStartTest, AMeshWithoutARecordIsTheFirstToMakeRoom) {
  Fill(2);
  const auto bytes = SphereBytes(9, 3);
  const std::filesystem::path file = FolderOf("meshes") / DigestOf(bytes).ToHex();
  disk_.SetContents(file, bytes);
  Open();
  options_.store_limit_bytes = library_->counters().store_bytes + 100;
  Open();
  const auto added = Upload(library_.get(), SphereBytes(8, 3), BuildKind::kBox);
  ASSERT_TRUE(added.ok()) << added.error().message;
  EXPECT_FALSE(disk_.Contents(file).has_value());
  EXPECT_EQ(library_->counters().unrecorded_meshes, 0u);
  EXPECT_EQ(library_->counters().trees, 3u) << "before any mesh that a record names";
}

TEST_F(LibraryStartTest, LinksOfFoldersAreFollowedAndOneToNothingIsAMissingFolder) {
  Fill(2);
  disk_.Link("data", "/big/kdray");
  ExpectAllThere();
  library_.reset();
  disk_.Link("/big/kdray/meshes", "/other/meshes");
  ExpectAllThere();
  const TreeId third = Add(SphereBytes(3, 3));
  answers_[third] = AnswersOf(library_.get(), third);
  ExpectAllThere();
  library_.reset();
  disk_.Unmount("/other/meshes", SimulatedDisk::Absence::kMissing);
  ExpectRefused("folder meshes is missing");
  disk_.Mount("/other/meshes");
  ExpectAllThere();
}

TEST_F(LibraryStartTest, AFolderThatGoesWhileItRunsIsNeverAnsweredWithSuccess) {
  for (const char* folder : {"meshes", "catalog"}) {
    Fill(2);
    Open();
    const TreeId id = answers_.begin()->first;
    disk_.Unmount(FolderOf(folder), SimulatedDisk::Absence::kMissing);
    const auto again = Upload(library_.get(), SphereBytes(1, 3));
    const auto added = Upload(library_.get(), SphereBytes(7, 3));
    for (const auto* answer : {&again, &added}) {
      ASSERT_FALSE(answer->ok()) << folder;
      EXPECT_EQ(answer->error().code, ErrorCode::kIo) << "not kNotFound: no name was requested";
    }
    const core::Status deleted = library_->Delete(id);
    if (std::string(folder) == "catalog") {
      ASSERT_FALSE(deleted.ok());
      EXPECT_EQ(deleted.error().code, ErrorCode::kIo);
    } else {
      EXPECT_TRUE(deleted.ok());
      answers_.erase(id);
    }
    library_.reset();
    disk_.Mount(FolderOf(folder));
    ExpectAllThere();
  }
}

// The same with the operating system's files.
class RealStartTest : public testing::Test {
 protected:
  RealStartTest() { options_.data_dir = folder_.path() / "data"; }

  std::unique_ptr<TreeLibrary> Open() {
    auto library = TreeLibrary::Open(options_);
    EXPECT_TRUE(library.ok()) << library.error().message;
    return library.ok() ? *std::move(library) : nullptr;
  }
  void Fill() {
    const auto library = Open();
    for (int number = 1; number <= 3; ++number) {
      const auto added = Upload(library.get(), SphereBytes(number, 3));
      ASSERT_TRUE(added.ok()) << added.error().message;
      EXPECT_TRUE(library->Load(added->id, Soon()).ok());
    }
  }
  std::map<std::string, std::string> AllFiles() const {
    std::map<std::string, std::string> files;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(options_.data_dir)) {
      if (!entry.is_regular_file()) continue;
      std::ifstream in(entry.path(), std::ios::binary);
      files[entry.path()] = std::string(std::istreambuf_iterator<char>(in), {});
    }
    return files;
  }
  void ExpectRefused(const std::string& why) {
    const auto before = AllFiles();
    const auto library = TreeLibrary::Open(options_);
    ASSERT_FALSE(library.ok()) << why;
    EXPECT_THAT(library.error().message, HasSubstr(why));
    EXPECT_EQ(AllFiles(), before);
  }
  void ExpectAllThere() {
    const auto library = Open();
    ASSERT_NE(library, nullptr);
    EXPECT_EQ(library->counters().trees, 3u);
    EXPECT_EQ(library->counters().unreadable_meshes + library->counters().unrecorded_meshes, 0u);
    for (const auto& info : library->List(std::nullopt, std::nullopt, 10)) {
      EXPECT_TRUE(library->OpenMesh(info.record.id).ok());
    }
  }
  void ChownAll(uid_t user) {
    ASSERT_EQ(lchown(options_.data_dir.c_str(), user, user), 0);
    for (const auto& entry : std::filesystem::recursive_directory_iterator(options_.data_dir)) {
      ASSERT_EQ(lchown(entry.path().c_str(), user, user), 0);
    }
  }

  TemporaryFolder folder_;
  core::LibraryOptions options_;
};

TEST_F(RealStartTest, AnotherOwnerRefusesTheStartAndLosesNothing) {
  if (geteuid() != 0) GTEST_SKIP() << "only root can give files away";
  Fill();
  ChownAll(12345);
  ExpectRefused("belongs to user 12345, but this process runs as user 0");
  ChownAll(0);
  for (const auto& entry : std::filesystem::directory_iterator(options_.data_dir / "meshes")) {
    ASSERT_EQ(lchown(entry.path().c_str(), 12345, 12345), 0);
  }
  ExpectRefused("3 of 3 recorded meshes cannot be read");
  ChownAll(0);
  ExpectAllThere();
}

TEST_F(RealStartTest, AFolderThatWasMovedRefusesTheStartAndIsNotMadeAgain) {
  Fill();
  const auto meshes = options_.data_dir / "meshes";
  std::filesystem::rename(meshes, folder_.path() / "away");
  ExpectRefused("folder meshes is missing, but the catalog names 3 meshes");
  EXPECT_FALSE(std::filesystem::exists(meshes));
  std::ofstream(meshes) << "a file";
  ExpectRefused("folder meshes");
  std::filesystem::remove(meshes);
  std::filesystem::create_symlink(folder_.path() / "nowhere", meshes);
  ExpectRefused("folder meshes is missing");
  std::filesystem::remove(meshes);
  std::filesystem::create_symlink(folder_.path() / "away", meshes);
  ExpectAllThere();
}

TEST_F(RealStartTest, AFolderOfDerivedFilesThatIsMissingMayBeMadeAgainEmpty) {
  Fill();
  for (const char* const name : {"trees", "parsed", "measured"}) {
    const auto folder = options_.data_dir / name;
    std::filesystem::remove_all(folder);
    ExpectRefused("folder " + std::string(name) + " is missing");
    ExpectRefused("(its files can be made again; make an empty folder in its place)");
    std::filesystem::create_directory(folder);
  }
  ExpectAllThere();
}

TEST_F(RealStartTest, ADataDirectoryMayBeALink) {
  const auto link = folder_.path() / "link";
  std::filesystem::create_directory(folder_.path() / "target");
  std::filesystem::create_directory_symlink(folder_.path() / "target", link);
  options_.data_dir = link;
  Fill();
  ExpectAllThere();
  options_.data_dir = folder_.path() / "dangling";
  std::filesystem::create_directory_symlink(folder_.path() / "nowhere", options_.data_dir);
  EXPECT_FALSE(TreeLibrary::Open(options_).ok());
}

TEST_F(RealStartTest, AMeshThatIsALinkIsNotReadAndAnUploadPutsAFileInItsPlace) {
  Fill();
  const auto bytes = SphereBytes(1, 3);
  const auto file = options_.data_dir / "meshes" / DigestOf(bytes).ToHex();
  const auto elsewhere = folder_.path() / "elsewhere";
  std::filesystem::rename(file, elsewhere);
  std::filesystem::create_symlink(elsewhere, file);
  {
    const auto library = Open();
    ASSERT_NE(library, nullptr);
    EXPECT_EQ(library->counters().unreadable_meshes, 1u);
    const TreeId id{DigestOf(bytes), std::nullopt};
    EXPECT_EQ(library->OpenMesh(id).error().code, ErrorCode::kCorrupt);
    EXPECT_TRUE(Upload(library.get(), bytes).ok());
    EXPECT_TRUE(library->OpenMesh(id).ok());
  }
  EXPECT_TRUE(std::filesystem::is_regular_file(std::filesystem::symlink_status(file)));
  EXPECT_TRUE(std::filesystem::exists(elsewhere));
  ExpectAllThere();
}

}  // namespace
}  // namespace kdray::test
