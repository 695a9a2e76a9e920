// SPDX-License-Identifier: Apache-2.0
// Reading and writing stored files ends soon after its cancellation. A write that is cut off leaves
// no file, and a read that is cut off says nothing about the file.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/accel/tree.h"
#include "core/store/blob_store.h"
#include "core/store/checked_file.h"
#include "core/store/parsed_mesh_file.h"
#include "core/store/scene_store.h"
#include "core/store/tree_file.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/mesh_files.h"
#include "tests/support/shapes.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/temporary_folder.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::CancelToken;
using core::ErrorCode;
using core::FileKind;
using core::Sha256Digest;
using core::Status;
using std::chrono::milliseconds;

constexpr FileKind kKind{"a_test__", 1};
constexpr std::size_t kMiB = std::size_t{1} << 20;

// A file of that kind with one array of bytes, as long as asked for, that is nowhere.
class EndlessFile final : public core::ReadableFile {
 public:
  explicit EndlessFile(std::uint64_t array_bytes) {
    SimulatedDisk disk;
    core::BlobStore store(&disk, "folder");
    EXPECT_TRUE(store.Open().ok());
    core::CheckedWriter writer(*store.Create(), kKind);
    writer.Put(array_bytes);
    EXPECT_TRUE(std::move(writer).Finish()->Commit("file").ok());
    head_ = *disk.Contents("folder/file");
    size_ = head_.size() + array_bytes;
    head_.resize(16 + sizeof array_bytes);
  }
  std::uint64_t size() const override { return size_; }
  Status ReadAt(std::uint64_t offset, std::span<std::byte> out) const override {
    std::fill(out.begin(), out.end(), std::byte{7});
    for (; offset < head_.size() && !out.empty(); ++offset, out = out.subspan(1)) {
      out[0] = head_[static_cast<std::size_t>(offset)];
    }
    return {};
  }

 private:
  std::vector<std::byte> head_;
  std::uint64_t size_ = 0;
};

TEST(CancelledFile, ReadingALargeArrayEnds) {
  const std::uint64_t bytes = 1024 * kMiB * CancelScale();
  for (const milliseconds after : {milliseconds(5), milliseconds(60)}) {
    ExpectPrompt(CancelDuring(after,
                              [&](const CancelToken& token) {
                                core::CheckedReader reader(std::make_unique<EndlessFile>(bytes),
                                                           kKind, token);
                                EXPECT_TRUE(reader.GetArray<std::uint8_t>().empty());
                                return reader.Finish();
                              }),
                 "after " + std::to_string(after.count()) + " ms");
  }
}

TEST(CancelledFile, WritingALargeArrayEndsAndLeavesNoFile) {
  const TemporaryFolder folder;
  core::BlobStore store(&core::PosixFileSystem(), folder.path());
  ASSERT_TRUE(store.Open().ok());
  const std::vector<std::uint32_t> values(16 * kMiB / 4);
  for (const milliseconds after : {milliseconds(5), milliseconds(40)}) {
    ExpectPrompt(CancelDuring(after,
                              [&](const CancelToken& token) {
                                core::CheckedWriter writer(*store.Create(), kKind, token);
                                for (std::size_t i = 0; i < 64 * CancelScale(); ++i) {
                                  writer.PutArray(std::span(values));
                                }
                                return StatusOf(std::move(writer).Finish());
                              }),
                 "after " + std::to_string(after.count()) + " ms");
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  }
}

struct Stored {
  Sha256Digest digest = core::HashBytes(Bytes("a mesh"));
  std::optional<core::ParsedMesh> mesh;
  std::optional<core::Tree> tree;
  core::TreeFileKey key;
};

// A mesh and a tree of some MiB each.
Stored LargeScene() {
  Stored stored;
  auto mesh = core::TriangleMesh::Create(Soup(60'000, 0.02, 1));
  core::MeshFacts facts;
  facts.triangles = mesh->triangle_count();
  facts.double_vertices = mesh->has_double_vertices();
  facts.frame = mesh->frame();
  facts.bounds = mesh->bounds();
  facts.memory_bytes = mesh->bytes();
  stored.key = {stored.digest, mesh->triangle_count(), BuildKind::kBvh};
  stored.tree = *BuildTree(*mesh, BuildKind::kBvh);
  stored.mesh = core::ParsedMesh{facts, *std::move(mesh)};
  return stored;
}

TEST(CancelledFile, OfAMeshOrATreeIsWholeOrNotThere) {
  const Stored stored = LargeScene();
  for (const bool is_tree : {false, true}) {
    bool completed = false;
    std::uint64_t looks = 1;
    for (; !completed; ++looks) {
      SimulatedDisk disk;
      core::BlobStore store(&disk, "folder");
      ASSERT_TRUE(store.Open().ok());
      const CancelToken token = CancelledAtLook(looks);
      auto written = is_tree
                         ? WriteTreeFile(stored.key, *stored.tree, *store.Create(), token)
                         : WriteParsedMeshFile(stored.digest, *stored.mesh, *store.Create(), token);
      completed = written.ok();
      if (completed) {
        ASSERT_TRUE(written->Commit("file").ok());
        EXPECT_GE(looks, disk.Contents("folder/file")->size() / kMiB) << "it looks at each MiB";
        const auto file = [&] { return *store.Read("file"); };
        EXPECT_TRUE(is_tree ? ReadTreeFile(stored.key, file()).ok()
                            : ReadParsedMeshFile(stored.digest, file()).ok());
      } else {
        ASSERT_EQ(written.error().code, ErrorCode::kCancelled);
        EXPECT_TRUE(disk.FilesIn("folder").empty());
      }
    }
    EXPECT_GT(looks, 3U);
  }
}

TEST(CancelledFile, WhenReadIsNotDamaged) {
  const Stored stored = LargeScene();
  SimulatedDisk disk;
  auto store = *core::SceneStore::Open({&disk, "data", std::nullopt});
  ASSERT_TRUE(store->Load().ok());
  store->WriteParsed(stored.digest, *stored.mesh);
  store->WriteTree(stored.key, *stored.tree);
  for (const bool is_tree : {false, true}) {
    bool completed = false;
    std::uint64_t looks = 1;
    for (; !completed; ++looks) {
      const CancelToken token = CancelledAtLook(looks);
      const Status status = is_tree ? StatusOf(store->ReadTree(stored.key, token))
                                    : StatusOf(store->ReadParsed(stored.digest, token));
      completed = status.ok();
      ASSERT_TRUE(completed || status.error().code == ErrorCode::kCancelled);
    }
    EXPECT_GT(looks, 3U);
  }
  EXPECT_EQ(store->damaged_files(), 0U);
}

class CancelledMeshTest : public testing::Test {
 protected:
  CancelledMeshTest() {
    store_ = *core::SceneStore::Open({&disk_, "data", std::nullopt});
    EXPECT_TRUE(store_->Load().ok());
    std::vector<std::byte> bytes(192 * kMiB * CancelScale(), std::byte{3});
    digest_ = core::HashBytes(bytes);
    disk_.SetContents("data/meshes/" + digest_.ToHex(), std::move(bytes));
  }

  SimulatedDisk disk_;
  std::unique_ptr<core::SceneStore> store_;
  Sha256Digest digest_;
};

TEST_F(CancelledMeshTest, ReadingOrCheckingItsBytesEndsAndSaysNothingAboutThem) {
  for (const milliseconds after : {milliseconds(5), milliseconds(40)}) {
    ExpectPrompt(CancelDuring(after,
                              [&](const CancelToken& token) {
                                return StatusOf(store_->ReadMesh(digest_, token));
                              }),
                 "ReadMesh");
    ExpectPrompt(CancelDuring(after,
                              [&](const CancelToken& token) {
                                return StatusOf(store_->OpenMesh(digest_, token));
                              }),
                 "OpenMesh");
  }
  EXPECT_EQ(store_->damaged_files(), 0U);
  EXPECT_TRUE(store_->OpenMesh(digest_).ok());
}

}  // namespace
}  // namespace kdray::test
