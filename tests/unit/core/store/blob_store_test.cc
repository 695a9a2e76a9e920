// SPDX-License-Identifier: Apache-2.0
#include "core/store/blob_store.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tests/support/mesh_files.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/temporary_folder.h"

namespace kdray::core {
namespace {

using test::Bytes;
using test::SimulatedDisk;
using test::TemporaryFolder;
using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::string_view kOld = "the old contents";
constexpr std::string_view kNew = "the new contents, which are longer";
constexpr SimulatedDisk::Loss kLosses[] = {SimulatedDisk::Loss::kNothing,
                                           SimulatedDisk::Loss::kContents,
                                           SimulatedDisk::Loss::kEverything};

Status WriteBlob(BlobStore* store, std::string_view name, std::string_view text) {
  Result<NewBlob> blob = store->Create();
  if (!blob.ok()) return std::move(blob).error();
  // In two pieces, as an upload comes.
  const std::vector<std::byte> bytes = Bytes(text);
  const auto all = std::span<const std::byte>(bytes);
  if (Status status = blob->Append(all.first(5)); !status.ok()) return status;
  if (Status status = blob->Append(all.subspan(5)); !status.ok()) return status;
  return blob->Commit(name);
}

std::optional<std::string> ReadBlob(const BlobStore& store, std::string_view name) {
  const Result<std::unique_ptr<ReadableFile>> file = store.Read(name);
  if (!file.ok()) return std::nullopt;
  std::string text((*file)->size(), ' ');
  EXPECT_TRUE((*file)->ReadAt(0, std::as_writable_bytes(std::span(text))).ok());
  return text;
}

// Of a write that goes well: create, two writes, sync, rename, sync of the folder.
std::uint64_t OperationsOfAWrite() {
  SimulatedDisk disk;
  BlobStore store(&disk, "blobs");
  EXPECT_TRUE(store.Open().ok());
  const std::uint64_t before = disk.operations();
  EXPECT_TRUE(WriteBlob(&store, "name", kNew).ok());
  return disk.operations() - before;
}

TEST(BlobStore, ACommittedFileSurvivesWhateverIsLost) {
  for (const auto loss : kLosses) {
    SimulatedDisk disk;
    BlobStore store(&disk, "blobs");
    ASSERT_TRUE(store.Open().ok());
    ASSERT_TRUE(WriteBlob(&store, "name", kNew).ok());
    disk.Restart(loss);
    EXPECT_EQ(ReadBlob(store, "name"), kNew);
  }
}

TEST(BlobStore, ARemovedFileStaysAwayWhateverIsLost) {
  for (const auto loss : kLosses) {
    SimulatedDisk disk;
    BlobStore store(&disk, "blobs");
    ASSERT_TRUE(store.Open().ok());
    ASSERT_TRUE(WriteBlob(&store, "name", kNew).ok());
    ASSERT_TRUE(store.Remove("name").ok());
    disk.Restart(loss);
    EXPECT_EQ(ReadBlob(store, "name"), std::nullopt);
  }
}

TEST(BlobStore, AnUncommittedFileLeavesNothing) {
  SimulatedDisk disk;
  BlobStore store(&disk, "blobs");
  ASSERT_TRUE(store.Open().ok());
  {
    Result<NewBlob> blob = store.Create();
    ASSERT_TRUE(blob.ok());
    ASSERT_TRUE(blob->Append(Bytes(kNew)).ok());
    ASSERT_TRUE(blob->Sync().ok());
  }
  EXPECT_THAT(disk.FilesIn("blobs"), IsEmpty());
}

TEST(BlobStore, EachOperationOfAWriteMayFailOnceAndTheFileIsOldOrNew) {
  const std::uint64_t operations = OperationsOfAWrite();
  EXPECT_EQ(operations, 6u);
  for (std::uint64_t n = 0; n < operations; ++n) {
    for (const ErrorCode code : {ErrorCode::kIo, ErrorCode::kStoreFull}) {
      SimulatedDisk disk;
      BlobStore store(&disk, "blobs");
      ASSERT_TRUE(store.Open().ok());
      ASSERT_TRUE(WriteBlob(&store, "name", kOld).ok());
      disk.FailAt(n, code);
      const Status status = WriteBlob(&store, "name", kNew);
      const std::optional<std::string> now = ReadBlob(store, "name");
      EXPECT_TRUE(now == kOld || now == kNew) << "operation " << n;
      ASSERT_FALSE(status.ok()) << "operation " << n;
      EXPECT_EQ(status.error().code, code);
      EXPECT_THAT(disk.FilesIn("blobs"), ElementsAre("name")) << "operation " << n;
    }
  }
}

TEST(BlobStore, ACrashAfterEachOperationLeavesTheOldFileOrTheNew) {
  for (const bool with_old : {false, true}) {
    for (const auto loss : kLosses) {
      const std::uint64_t operations = OperationsOfAWrite();
      for (std::uint64_t n = 0; n < operations; ++n) {
        SimulatedDisk disk;
        BlobStore store(&disk, "blobs");
        ASSERT_TRUE(store.Open().ok());
        if (with_old) {
          ASSERT_TRUE(WriteBlob(&store, "name", kOld).ok());
        }
        disk.DieAt(n);
        EXPECT_FALSE(WriteBlob(&store, "name", kNew).ok());
        disk.Restart(loss);
        BlobStore again(&disk, "blobs");
        ASSERT_TRUE(again.Open().ok());
        const std::optional<std::string> now = ReadBlob(again, "name");
        EXPECT_TRUE(now == kNew || (with_old ? now == kOld : !now.has_value()))
            << "operation " << n << ": " << now.value_or("nothing");
        for (const std::string& name : disk.FilesIn("blobs")) EXPECT_EQ(name, "name");
      }
    }
  }
}

TEST(BlobStore, OpenSweepsWhatACrashLeft) {
  SimulatedDisk disk;
  BlobStore store(&disk, "blobs");
  ASSERT_TRUE(store.Open().ok());
  Result<NewBlob> blob = store.Create();
  ASSERT_TRUE(blob.ok());
  ASSERT_TRUE(blob->Append(Bytes(kNew)).ok());
  disk.SetContents("blobs/name", Bytes(kOld));
  disk.Restart(SimulatedDisk::Loss::kNothing);
  ASSERT_EQ(disk.FilesIn("blobs").size(), 2u);
  BlobStore again(&disk, "blobs");
  ASSERT_TRUE(again.Open().ok());
  EXPECT_THAT(disk.FilesIn("blobs"), ElementsAre("name"));
}

TEST(BlobStore, ListShowsNoTemporaryFiles) {
  SimulatedDisk disk;
  BlobStore store(&disk, "blobs");
  ASSERT_TRUE(store.Open().ok());
  ASSERT_TRUE(WriteBlob(&store, "name", kOld).ok());
  const Result<NewBlob> unfinished = store.Create();
  ASSERT_TRUE(unfinished.ok());
  const Result<std::vector<FileInfo>> files = store.List();
  ASSERT_TRUE(files.ok());
  ASSERT_EQ(files->size(), 1u);
  EXPECT_EQ((*files)[0].name, "name");
  EXPECT_EQ((*files)[0].bytes, kOld.size());
}

// The rest is about the operating system's files.

class PosixFiles : public testing::Test {
 protected:
  PosixFiles() : store_(&PosixFileSystem(), folder_.path() / "a" / "blobs") {
    EXPECT_TRUE(store_.Open().ok());
  }
  std::filesystem::path Path(std::string_view name) const {
    return folder_.path() / "a" / "blobs" / name;
  }
  ErrorCode CodeOfReading(std::string_view name) const {
    const auto file = store_.Read(name);
    return file.ok() ? ErrorCode::kInternal : file.error().code;
  }

  TemporaryFolder folder_;
  BlobStore store_;
};

TEST_F(PosixFiles, AreWrittenReadListedAndRemoved) {
  ASSERT_TRUE(WriteBlob(&store_, "name", kOld).ok());
  ASSERT_TRUE(WriteBlob(&store_, "name", kNew).ok());
  EXPECT_EQ(ReadBlob(store_, "name"), kNew);
  const Result<std::vector<FileInfo>> files = store_.List();
  ASSERT_TRUE(files.ok());
  ASSERT_EQ(files->size(), 1u);
  EXPECT_EQ((*files)[0].name, "name");
  EXPECT_EQ((*files)[0].bytes, kNew.size());
  EXPECT_TRUE((*files)[0].readable);
  EXPECT_TRUE(store_.Touch("name").ok());
  EXPECT_TRUE(store_.Remove("name").ok());
  EXPECT_TRUE(store_.Remove("name").ok()) << "nothing there is success";
  EXPECT_EQ(CodeOfReading("name"), ErrorCode::kNotFound);
}

TEST_F(PosixFiles, AreForThisUserAlone) {
  ASSERT_TRUE(WriteBlob(&store_, "name", kOld).ok());
  struct stat status {};
  ASSERT_EQ(stat(Path("name").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777u, 0600u);
  ASSERT_EQ(stat(Path("").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777u, 0700u);
}

TEST_F(PosixFiles, LinksFoldersAndPipesAreNotRead) {
  ASSERT_TRUE(WriteBlob(&store_, "real", kOld).ok());
  std::filesystem::create_symlink(Path("real"), Path("link"));
  std::filesystem::create_directory(Path("folder"));
  ASSERT_EQ(mkfifo(Path("pipe").c_str(), 0600), 0);
  EXPECT_EQ(CodeOfReading("link"), ErrorCode::kCorrupt);
  EXPECT_EQ(CodeOfReading("folder"), ErrorCode::kCorrupt);
  EXPECT_EQ(CodeOfReading("pipe"), ErrorCode::kCorrupt);
  const Result<std::vector<FileInfo>> files = store_.List();
  ASSERT_TRUE(files.ok());
  for (const FileInfo& file : *files) EXPECT_EQ(file.readable, file.name == "real") << file.name;
}

TEST_F(PosixFiles, ALinkIsReplacedNotFollowed) {
  ASSERT_TRUE(WriteBlob(&store_, "target", kOld).ok());
  std::filesystem::create_symlink(Path("target"), Path("name"));
  ASSERT_TRUE(WriteBlob(&store_, "name", kNew).ok());
  EXPECT_EQ(ReadBlob(store_, "name"), kNew);
  EXPECT_EQ(ReadBlob(store_, "target"), kOld);
}

TEST_F(PosixFiles, AnotherUsersFileIsNotRead) {
  if (geteuid() != 0) GTEST_SKIP() << "only root can give a file away";
  ASSERT_TRUE(WriteBlob(&store_, "name", kOld).ok());
  ASSERT_EQ(chown(Path("name").c_str(), 12345, 12345), 0);
  EXPECT_EQ(CodeOfReading("name"), ErrorCode::kCorrupt);
}

TEST_F(PosixFiles, AFileThatShrinksUnderAReaderGivesAnErrorNotASignal) {
  ASSERT_TRUE(WriteBlob(&store_, "name", kNew).ok());
  const auto file = store_.Read("name");
  ASSERT_TRUE(file.ok());
  std::filesystem::resize_file(Path("name"), 4);
  std::vector<std::byte> out(kNew.size());
  const Status status = (*file)->ReadAt(0, out);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, ErrorCode::kCorrupt);
}

TEST_F(PosixFiles, AFullDiskIsToldApartFromABrokenOne) {
  // The limit of a file's size stands in for the disk's: it meets root as well.
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small{16, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const Status status = WriteBlob(&store_, "name", kNew);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, ErrorCode::kStoreFull);
  EXPECT_TRUE(std::filesystem::is_empty(Path("")));
}

TEST_F(PosixFiles, ALockIsHeldOnceUntilItIsLetGo) {
  const auto path = folder_.path() / "lock";
  auto held = PosixFileSystem().Lock(path);
  ASSERT_TRUE(held.ok());
  const auto second = PosixFileSystem().Lock(path);
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.error().code, ErrorCode::kInvalidArgument);
  held->reset();
  EXPECT_TRUE(PosixFileSystem().Lock(path).ok());
}

}  // namespace
}  // namespace kdray::core
