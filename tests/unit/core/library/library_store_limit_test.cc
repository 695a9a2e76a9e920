// SPDX-License-Identifier: Apache-2.0
// Which files a TreeLibrary gives up when its store is full.
#include <gtest/gtest.h>

#include <span>
#include <string>
#include <vector>

#include "core/library/tree_library.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::ErrorCode;
using core::TreeId;
using core::TreeLibrary;

class StoreLimitTest : public LibraryTest {
 protected:
  static constexpr int kRings = 10;
  StoreLimitTest() {
    Open();
    mesh_ = SphereBytes(1, kRings).size();
  }
  // In order, each with its derived files.
  void Fill(int count) {
    for (int number = 1; number <= count; ++number) {
      ids_.push_back(Add(SphereBytes(number, kRings), BuildKind::kKdSah));
      Settle();
    }
  }
  bool Has(const char* folder, const TreeId& id) const {
    const std::string name = std::string(folder) == "trees" ? id.ToString() : id.mesh.ToHex();
    return disk_.Contents(std::filesystem::path("data") / folder / name).has_value();
  }

  std::uint64_t mesh_ = 0;
  std::vector<TreeId> ids_;
};

TEST_F(StoreLimitTest, DerivedFilesGoBeforeAnyMeshAndTheLeastRecentlyUsedFirst) {
  Fill(3);
  options_.store_limit_bytes = library_->counters().store_bytes;
  Open();
  EXPECT_TRUE(library_->Load(ids_[0], Soon()).ok());  // the first is now used most recently
  const auto files_left = [&] { return std::pair(FilesIn("trees"), FilesIn("parsed")); };
  const std::pair<std::size_t, std::size_t> order[] = {{2, 3}, {1, 3}, {0, 3},
                                                       {0, 2}, {0, 1}, {0, 0}};
  std::vector<TreeLibrary::Upload> uploads;
  for (const auto& expected : order) {
    // A little at a time, until one file has to go.
    const std::uint64_t bytes_before = library_->counters().store_bytes;
    while (library_->counters().store_bytes == bytes_before) {
      auto upload = library_->BeginUpload(256);
      ASSERT_TRUE(upload.ok());
      ASSERT_TRUE(upload->Append(std::vector<std::byte>(256)).ok());
      uploads.push_back(*std::move(upload));
    }
    EXPECT_EQ(files_left(), expected);
    EXPECT_EQ(Has("trees", ids_[1]), false);
    EXPECT_EQ(Has("trees", ids_[0]), expected.first > 0) << "used most recently, so it goes last";
    EXPECT_EQ(Has("parsed", ids_[0]), expected.second > 0);
  }
  EXPECT_EQ(library_->counters().trees, 3u);
  for (const TreeId& id : ids_) EXPECT_TRUE(Has("meshes", id));
  EXPECT_TRUE(library_->Load(ids_[1], Soon()).ok()) << "parsed and built again";
  EXPECT_EQ(library_->counters().rebuilds, 1u);
}

TEST_F(StoreLimitTest, ThenWholeMeshesGoTheLeastRecentlyUsedFirst) {
  options_.store_limit_bytes = 3 * mesh_ + mesh_ / 8;
  Open();
  Fill(3);
  EXPECT_EQ(library_->counters().trees, 3u);
  EXPECT_TRUE(library_->Load(ids_[0], Soon()).ok());
  const TreeId fourth = Add(SphereBytes(4, kRings), BuildKind::kKdSah);
  EXPECT_EQ(CodeOfFind(ids_[1]), ErrorCode::kNotFound);
  EXPECT_FALSE(Has("meshes", ids_[1]) || Has("parsed", ids_[1]) || Has("trees", ids_[1]));
  for (const TreeId& id : {ids_[0], ids_[2], fourth}) EXPECT_TRUE(library_->Find(id).ok());
  EXPECT_LE(library_->counters().store_bytes, *options_.store_limit_bytes);
  EXPECT_EQ(FilesIn("parsed") + FilesIn("trees"), 0u) << "there is no room for them";
}

TEST_F(StoreLimitTest, TheOrderOfUseSurvivesARestart) {
  options_.store_limit_bytes = 3 * mesh_ + mesh_ / 2;
  Open();
  Fill(3);
  EXPECT_TRUE(library_->Load(ids_[0], Soon()).ok());
  Settle();
  Add(SphereBytes(4, kRings), BuildKind::kKdSah);
  EXPECT_TRUE(library_->Find(ids_[0]).ok());
  EXPECT_EQ(CodeOfFind(ids_[1]), ErrorCode::kNotFound);
}

TEST_F(StoreLimitTest, UploadsUnderWayAreTogetherNoLargerThanTheStore) {
  options_.store_limit_bytes = 2 * mesh_ + mesh_ / 2;
  Open();
  std::vector<TreeLibrary::Upload> uploads;
  for (int i = 0; i < 3; ++i) {
    auto upload = library_->BeginUpload(mesh_);
    ASSERT_TRUE(upload.ok());
    uploads.push_back(*std::move(upload));
  }
  const std::vector<std::byte> bytes = SphereBytes(1, kRings);
  EXPECT_TRUE(uploads[0].Append(bytes).ok());
  EXPECT_TRUE(uploads[1].Append(bytes).ok());
  const core::Status third = uploads[2].Append(bytes);
  ASSERT_FALSE(third.ok());
  EXPECT_EQ(third.error().code, ErrorCode::kStoreFull);
  EXPECT_TRUE(library_->Finish(std::move(uploads[0]), BuildKind::kBox).ok());
  const auto never = library_->BeginUpload(3 * mesh_);
  ASSERT_FALSE(never.ok());
  EXPECT_EQ(never.error().code, ErrorCode::kMeshTooLarge);
}

TEST_F(StoreLimitTest, AnUploadOfUnknownSizeIsTooLargeOnceItCouldNeverFit) {
  options_.store_limit_bytes = mesh_ - 1;
  Open();
  auto upload = library_->BeginUpload(0);
  ASSERT_TRUE(upload.ok());
  std::vector<std::byte> bytes = SphereBytes(1, kRings);
  ASSERT_EQ(bytes.size(), mesh_);
  EXPECT_TRUE(upload->Append(std::span(bytes).first(mesh_ - 1)).ok());
  const core::Status last = upload->Append(std::span(bytes).last(1));
  ASSERT_FALSE(last.ok());
  EXPECT_EQ(last.error().code, ErrorCode::kMeshTooLarge);
}

TEST_F(StoreLimitTest, NoMeshGoesForAnUploadThatIsNotComplete) {
  options_.store_limit_bytes = 3 * mesh_ + mesh_ / 8;
  Open();
  Fill(3);
  {
    auto upload = library_->BeginUpload(mesh_);
    ASSERT_TRUE(upload.ok());
    EXPECT_EQ(library_->counters().trees, 3u) << "announced";
    std::vector<std::byte> bytes = SphereBytes(4, kRings);
    bytes.pop_back();
    ASSERT_TRUE(upload->Append(bytes).ok());
    EXPECT_EQ(library_->counters().trees, 3u) << "all there except the last byte";
  }
  for (const TreeId& id : ids_) EXPECT_TRUE(Has("meshes", id));
  EXPECT_TRUE(Upload(library_.get(), SphereBytes(4, kRings)).ok());
  EXPECT_EQ(library_->counters().trees, 3u) << "the fourth took the place of the first";
  EXPECT_FALSE(Has("meshes", ids_[0]));
}

TEST_F(StoreLimitTest, NoDerivedFileGoesForAnUploadThatIsOnlyAnnounced) {
  Fill(2);
  options_.store_limit_bytes = library_->counters().store_bytes;
  Open();
  const auto upload = library_->BeginUpload(*options_.store_limit_bytes);
  EXPECT_TRUE(upload.ok());
  EXPECT_EQ(FilesIn("trees"), 2u);
  EXPECT_EQ(FilesIn("parsed"), 2u);
}

}  // namespace
}  // namespace kdray::test
