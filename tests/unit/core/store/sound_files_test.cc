// SPDX-License-Identifier: Apache-2.0
// Stored meshes are hashed once, and again when they may have changed.
#include "core/store/sound_files.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "core/store/scene_store.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/watched_disk.h"

namespace kdray::core {
namespace {

class SoundFilesTest : public testing::Test {
 protected:
  SoundFilesTest() {
    disk_.on_read = [this](std::size_t bytes) { read_ += bytes; };
    store_ = *SceneStore::Open({&disk_, folder_.path() / "data", std::nullopt});
    EXPECT_TRUE(store_->Load().ok());
    Write(bytes_);
  }

  void Write(const std::vector<std::byte>& bytes) {
    std::ofstream file(Path(), std::ios::binary);
    file.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  }
  std::filesystem::path Path() const { return folder_.path() / "data/meshes" / mesh_.ToHex(); }
  /// Reads the whole file in pieces; the status of the last one.
  static Status ReadAll(const ReadableFile& file) {
    std::vector<std::byte> piece(1000);
    Status status;
    for (std::uint64_t at = 0; status.ok() && at < file.size(); at += piece.size()) {
      piece.resize(std::min<std::uint64_t>(1000, file.size() - at));
      status = file.ReadAt(at, piece);
    }
    return status;
  }

  test::TemporaryFolder folder_;
  test::WatchedDisk disk_{&PosixFileSystem()};
  std::uint64_t read_ = 0;
  const std::vector<std::byte> bytes_ = std::vector<std::byte>(12'345, std::byte{7});
  const Sha256Digest mesh_ = HashBytes(bytes_);
  std::unique_ptr<SceneStore> store_;
};

TEST_F(SoundFilesTest, AreHashedOnceBeforeTheyAreRead) {
  EXPECT_TRUE(store_->OpenMesh(mesh_).ok());
  EXPECT_EQ(read_, bytes_.size());
  for (int i = 0; i < 3; ++i) {
    const auto file = store_->OpenMesh(mesh_);
    ASSERT_TRUE(file.ok());
    EXPECT_EQ((*file)->size(), bytes_.size());
  }
  EXPECT_EQ(read_, bytes_.size()) << "only opened";
  EXPECT_TRUE(ReadAll(**store_->OpenMesh(mesh_)).ok());
  EXPECT_EQ(read_, 2 * bytes_.size());
}

TEST_F(SoundFilesTest, AreHashedAgainWhenTheyHaveChanged) {
  EXPECT_TRUE(store_->OpenMesh(mesh_).ok());
  std::vector<std::byte> damaged = bytes_;
  damaged.back() = std::byte{8};
  Write(damaged);
  const auto file = store_->OpenMesh(mesh_);
  ASSERT_FALSE(file.ok());
  EXPECT_EQ(file.error().code, ErrorCode::kCorrupt);
  EXPECT_EQ(store_->damaged_files(), 1U);
  Write(bytes_);
  EXPECT_TRUE(store_->OpenMesh(mesh_).ok());
}

TEST_F(SoundFilesTest, ThatChangeWhileTheyAreReadAreNotReadToTheEnd) {
  const auto file = store_->OpenMesh(mesh_);
  ASSERT_TRUE(file.ok());
  std::vector<std::byte> damaged = bytes_;
  damaged.front() = std::byte{8};
  Write(damaged);
  const Status status = ReadAll(**file);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, ErrorCode::kCorrupt);
  EXPECT_FALSE(store_->OpenMesh(mesh_).ok());
}

}  // namespace
}  // namespace kdray::core
