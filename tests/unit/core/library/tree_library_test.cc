// SPDX-License-Identifier: Apache-2.0
// Ids from upload to deletion, and one build however many ask.
#include "core/library/tree_library.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <random>
#include <set>
#include <thread>
#include <vector>

#include "tests/support/seed.h"
#include "tests/support/wait_until.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::CancelToken;
using core::ErrorCode;
using core::TreeId;
using core::TreeInfo;
using core::TreeLibrary;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

class TreeLibraryTest : public LibraryTest {
 protected:
  TreeLibraryTest() { Open(); }
};

TEST_F(TreeLibraryTest, AnUploadGetsTheIdThatItsBytesAndBuildSay) {
  const auto bytes = SphereBytes(1);
  const auto added = Upload(library_.get(), bytes, BuildKind::kBvh);
  ASSERT_TRUE(added.ok());
  EXPECT_EQ(added->id, (TreeId{DigestOf(bytes), BuildKind::kBvh}));
  EXPECT_FALSE(added->existed);
}

TEST_F(TreeLibraryTest, AnswersLikeATreeBuiltWithoutIt) {
  const core::MeshData data = UvSphere({0.5, 1, -2}, 1.1, 8, 16);
  const auto mesh = core::TriangleMesh::Create(data);
  ASSERT_TRUE(mesh.ok());
  const auto shared = std::make_shared<core::TriangleMesh>(*mesh);
  const auto tree = core::BuildTree(*shared, BuildKind::kBox);
  ASSERT_TRUE(tree.ok());
  const std::vector<core::Hit> expected = Answers({shared, std::make_shared<core::Tree>(*tree)});
  EXPECT_TRUE(std::any_of(expected.begin(), expected.end(),
                          [](const core::Hit& hit) { return hit.IsHit(); }));
  for (const BuildKind build : core::kAllBuildKinds) {
    EXPECT_EQ(AnswersOf(library_.get(), Add(SphereBytes(1), build)), expected) << core::Name(build);
  }
}

TEST_F(TreeLibraryTest, DescribesMeshAndTreeOnceReady) {
  const TreeId id = Add(SphereBytes(1), BuildKind::kKdSah);
  const auto info = library_->Find(id);
  ASSERT_TRUE(info.ok());
  EXPECT_TRUE(info->ready());
  EXPECT_EQ(info->progress, 1.0);
  EXPECT_EQ(info->record.mesh_bytes, SphereBytes(1).size());
  ASSERT_TRUE(info->record.mesh.has_value());
  EXPECT_EQ(info->record.mesh->triangles, 2u * 16u * 7u);
  EXPECT_TRUE(info->record.mesh->health.closed);
  EXPECT_GT(info->record.mesh->parse_ms, 0);
  EXPECT_EQ(info->record.tree->build, BuildKind::kKdSah);
  EXPECT_GT(info->record.tree->stats.leaves, 1u);
  EXPECT_GT(info->record.tree->build_ms, 0);
}

TEST_F(TreeLibraryTest, TheSameUploadAgainIsTheSameTree) {
  const TreeId id = Add(SphereBytes(1));
  const auto again = Upload(library_.get(), SphereBytes(1));
  ASSERT_TRUE(again.ok());
  EXPECT_TRUE(again->existed);
  EXPECT_EQ(again->id, id);
  EXPECT_EQ(library_->counters().builds, 1u);
  EXPECT_EQ(library_->counters().parses, 1u);
  EXPECT_EQ(FilesIn("meshes"), 1u);
}

TEST_F(TreeLibraryTest, AnUploadThatIsNotFinishedLeavesNothing) {
  {
    auto upload = library_->BeginUpload(100);
    ASSERT_TRUE(upload.ok());
    ASSERT_TRUE(upload->Append(Bytes("OFF\n")).ok());
    EXPECT_EQ(FilesIn("meshes"), 1u);
  }
  EXPECT_EQ(FilesIn("meshes"), 0u);
  EXPECT_EQ(library_->counters().store_bytes, 0u);
}

TEST_F(TreeLibraryTest, AnUploadWithoutAByteIsAnEmptyMesh) {
  const auto added = Upload(library_.get(), {});
  ASSERT_FALSE(added.ok());
  EXPECT_EQ(added.error().code, ErrorCode::kEmptyMesh);
  EXPECT_EQ(FilesIn("meshes"), 0u);
}

TEST_F(TreeLibraryTest, AutoIsAnIdOfItsOwnThatSharesTheTreeOfItsPick) {
  const auto bytes = SphereBytes(1);
  const TreeId automatic = Add(bytes);
  const TreeId named = Add(bytes, BuildKind::kBvh);
  EXPECT_NE(automatic, named);
  EXPECT_EQ(library_->counters().builds, 1u);
  const auto a = library_->Find(automatic);
  const auto b = library_->Find(named);
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(*a->record.tree, *b->record.tree) << "build time included";
  const auto one = library_->Load(automatic, Soon());
  const auto other = library_->Load(named, Soon());
  ASSERT_TRUE(one.ok() && other.ok());
  EXPECT_EQ(one->tree, other->tree);
}

TEST_F(TreeLibraryTest, AutoPicksTheBoxForTwelveTriangles) {
  const TreeId cube = Add(OffBytes(Cube({0, 0, 0}, 1)));
  EXPECT_EQ(library_->Find(cube)->record.tree->build, BuildKind::kBox);
  const TreeId sphere = Add(OffBytes(UvSphere({0, 0, 0}, 1, 3, 4)));  // 16 triangles
  EXPECT_NE(library_->Find(sphere)->record.tree->build, BuildKind::kBox);
}

TEST_F(TreeLibraryTest, DeletingOneIdLeavesTheOthersOfTheMesh) {
  const auto bytes = SphereBytes(1);
  for (const bool named_first : {false, true}) {
    const TreeId automatic = Add(bytes);
    const TreeId named = Add(bytes, BuildKind::kBvh);
    const TreeId box = Add(bytes, BuildKind::kBox);
    const std::vector<core::Hit> expected = AnswersOf(library_.get(), box);
    const TreeId first = named_first ? named : automatic;
    const TreeId second = named_first ? automatic : named;
    const std::uint64_t builds = library_->counters().builds;
    ASSERT_TRUE(library_->Delete(first).ok());
    EXPECT_EQ(CodeOfFind(first), ErrorCode::kNotFound);
    EXPECT_EQ(AnswersOf(library_.get(), second), expected);
    EXPECT_EQ(library_->counters().builds, builds) << "the shared tree stays";
    ASSERT_TRUE(library_->Delete(second).ok());
    EXPECT_EQ(AnswersOf(library_.get(), box), expected);
    EXPECT_EQ(FilesIn("meshes"), 1u);
    ASSERT_TRUE(library_->Delete(box).ok());
    EXPECT_EQ(FilesIn("meshes"), 0u) << "the mesh goes with its last id";
    EXPECT_EQ(FilesIn("catalog"), 0u);
  }
  Settle();
  EXPECT_EQ(FilesIn("parsed") + FilesIn("trees"), 0u);
  EXPECT_EQ(library_->counters().store_bytes, 0u);
  EXPECT_EQ(library_->counters().memory_bytes, 0u);
}

TEST_F(TreeLibraryTest, WhatIsNotThereIsNotFound) {
  const TreeId id{DigestOf(SphereBytes(1)), BuildKind::kBvh};
  EXPECT_EQ(CodeOfFind(id), ErrorCode::kNotFound);
  EXPECT_EQ(library_->Load(id, Soon()).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(library_->Delete(id).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(library_->OpenMesh(id).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(library_->AddBuild(id.mesh, id.build).error().code, ErrorCode::kNotFound);
  Add(SphereBytes(1), BuildKind::kBox);
  EXPECT_EQ(CodeOfFind(id), ErrorCode::kNotFound) << "another build of the mesh is there";
  EXPECT_TRUE(library_->AddBuild(id.mesh, id.build).ok());
  EXPECT_TRUE(library_->Load(id, Soon()).ok());
}

TEST_F(TreeLibraryTest, GivesTheMeshsBytesBack) {
  const auto bytes = SphereBytes(1);
  const TreeId id = Add(bytes);
  const auto file = library_->OpenMesh(id);
  ASSERT_TRUE(file.ok());
  ASSERT_TRUE(library_->Delete(id).ok());
  std::vector<std::byte> read((*file)->size());
  ASSERT_TRUE((*file)->ReadAt(0, read).ok()) << "readable while held, deleted or not";
  EXPECT_EQ(read, bytes);
}

TEST_F(TreeLibraryTest, AThousandAtOnceForOneColdMeshGetOneBuild) {
  const auto bytes = SphereBytes(1, 40);
  std::atomic<int> existed{0};
  std::atomic<int> answered{0};
  std::vector<std::thread> clients;
  for (int i = 0; i < 1000; ++i) {
    clients.emplace_back([&] {
      const auto added = Upload(library_.get(), bytes);
      if (added.ok() && added->existed) ++existed;
      if (added.ok() && library_->Load(added->id, Soon()).ok()) ++answered;
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(answered, 1000);
  EXPECT_EQ(existed, 999);
  EXPECT_EQ(library_->counters().builds, 1u);
  EXPECT_EQ(library_->counters().parses, 1u);
  EXPECT_EQ(FilesIn("meshes"), 1u);
}

TEST_F(TreeLibraryTest, AThousandAtOnceForATreeOnDiskGetOneLoad) {
  const TreeId id = Add(SphereBytes(1, 40));
  Settle();
  std::atomic<int> answered{0};
  std::vector<std::thread> clients;
  for (int i = 0; i < 1000; ++i) {
    clients.emplace_back([&] {
      if (library_->Load(id, Soon()).ok()) ++answered;
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(answered, 1000);
  EXPECT_EQ(library_->counters().loads, 1u);
  EXPECT_EQ(library_->counters().builds, 0u);
  EXPECT_EQ(library_->counters().parses, 0u);
}

TEST_F(TreeLibraryTest, EverybodyWhoWaitsForABrokenMeshGetsItsProblem) {
  const auto bytes = Bytes("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n");
  std::atomic<int> told{0};
  std::vector<std::thread> clients;
  for (int i = 0; i < 200; ++i) {
    clients.emplace_back([&] {
      const auto added = Upload(library_.get(), bytes);
      if (!added.ok()) return;
      const auto info =
          library_->Wait(added->id, steady_clock::now() + std::chrono::minutes(1), CancelToken());
      const auto loaded = library_->Load(added->id, Soon());
      if (!info.ok() && info.error().code == ErrorCode::kInvalidMesh && info.error().line == 6u &&
          !loaded.ok() && loaded.error().code == ErrorCode::kInvalidMesh) {
        ++told;
      }
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(told, 200);
}

TEST_F(TreeLibraryTest, ABrokenMeshIsNotKeptItsProblemIs) {
  struct Case {
    std::vector<std::byte> bytes;
    ErrorCode code;
  };
  const Case cases[] = {
      {Bytes("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"), ErrorCode::kInvalidMesh},
      {Bytes("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"), ErrorCode::kEmptyMesh},
      {Bytes("hello, world, this is no mesh at all\n"), ErrorCode::kUnsupportedMeshFormat},
  };
  for (const Case& c : cases) {
    const auto added = Upload(library_.get(), c.bytes);
    ASSERT_TRUE(added.ok());
    const auto loaded = library_->Load(added->id, Soon());
    ASSERT_FALSE(loaded.ok());
    EXPECT_EQ(loaded.error().code, c.code);
    EXPECT_EQ(CodeOfFind(added->id), c.code);
    EXPECT_TRUE(library_->List(std::nullopt, std::nullopt, 10).empty());
    const auto again = Upload(library_.get(), c.bytes);
    ASSERT_TRUE(again.ok());
    EXPECT_FALSE(again->existed) << "uploading again tries again";
    EXPECT_EQ(library_->Load(added->id, Soon()).error().code, c.code);
    EXPECT_TRUE(library_->Delete(added->id).ok());
    EXPECT_EQ(CodeOfFind(added->id), ErrorCode::kNotFound);
  }
  EXPECT_EQ(library_->counters().parses, 6u);
  Settle();
  EXPECT_EQ(FilesIn("meshes") + FilesIn("catalog") + FilesIn("parsed") + FilesIn("trees"), 0u);
}

TEST_F(TreeLibraryTest, AProblemIsForgottenAfterItsTime) {
  options_.keep_failure = milliseconds(30);
  Open();
  const auto added = Upload(library_.get(), Bytes("no mesh"));
  ASSERT_TRUE(added.ok());
  EXPECT_EQ(library_->Load(added->id, Soon()).error().code, ErrorCode::kUnsupportedMeshFormat);
  EXPECT_TRUE(test::WaitUntil([&] { return CodeOfFind(added->id) == ErrorCode::kNotFound; },
                              std::chrono::minutes(1)));
}

TEST_F(TreeLibraryTest, TreesTakeTurnsInMemory) {
  std::vector<TreeId> ids;
  std::vector<std::vector<core::Hit>> expected;
  for (int i = 0; i < 3; ++i) {
    ids.push_back(Add(SphereBytes(i, 20), BuildKind::kKdSah));
    expected.push_back(AnswersOf(library_.get(), ids.back()));
  }
  Settle();
  std::uint64_t largest = 0;
  for (const TreeId& id : ids) {
    const std::uint64_t before = library_->counters().memory_bytes;
    EXPECT_TRUE(library_->Load(id, Soon()).ok());
    largest = std::max(largest, library_->counters().memory_bytes - before);
  }
  options_.memory_limit_bytes = 2 * largest;
  Open();
  for (int round = 0; round < 3; ++round) {
    for (std::size_t i = 0; i < ids.size(); ++i) {
      EXPECT_EQ(AnswersOf(library_.get(), ids[i]), expected[i]);
      EXPECT_LE(library_->counters().memory_bytes, options_.memory_limit_bytes);
    }
  }
  EXPECT_GT(library_->counters().evictions, 0u);
  EXPECT_GT(library_->counters().loads, 3u);
  EXPECT_EQ(library_->counters().builds, 0u) << "what was evicted is read, not built";
}

TEST_F(TreeLibraryTest, ListsNewestFirstInPagesWithoutGapsOrRepeats) {
  std::vector<TreeId> ids;
  for (int i = 0; i < 7; ++i) ids.push_back(Add(SphereBytes(i, 3)));
  ids.push_back(Add(SphereBytes(3, 3), BuildKind::kBvh));
  std::vector<TreeId> listed;
  std::optional<TreeLibrary::Position> after;
  for (;;) {
    const std::vector<TreeInfo> page = library_->List(std::nullopt, after, 3);
    for (const TreeInfo& info : page) listed.push_back(info.record.id);
    if (page.size() < 3) break;
    after = TreeLibrary::Position{page.back().record.created_ms, page.back().record.id};
    // The place in the list holds even when its tree goes.
    if (listed.size() == 3) {
      EXPECT_TRUE(library_->Delete(listed.back()).ok());
    }
  }
  EXPECT_EQ(std::set<TreeId>(listed.begin(), listed.end()),
            std::set<TreeId>(ids.begin(), ids.end()));
  EXPECT_EQ(listed.size(), ids.size());
  const std::vector<TreeInfo> all = library_->List(std::nullopt, std::nullopt, 100);
  for (std::size_t i = 1; i < all.size(); ++i) {
    EXPECT_GE(all[i - 1].record.created_ms, all[i].record.created_ms);
  }
}

TEST_F(TreeLibraryTest, ListsTheTreesOfOneMesh) {
  const TreeId one = Add(SphereBytes(1, 3));
  const TreeId other = Add(SphereBytes(1, 3), BuildKind::kBvh);
  Add(SphereBytes(2, 3));
  std::set<TreeId> listed;
  for (const TreeInfo& info : library_->List(one.mesh, std::nullopt, 100)) {
    listed.insert(info.record.id);
  }
  EXPECT_EQ(listed, (std::set<TreeId>{one, other}));
  EXPECT_TRUE(library_->List(DigestOf(Bytes("none")), std::nullopt, 100).empty());
}

TEST_F(TreeLibraryTest, ManyClientsDoingEverythingAtOnceLeaveNoTrace) {
  std::vector<std::thread> clients;
  for (int client = 0; client < 8; ++client) {
    clients.emplace_back([&, client] {
      std::mt19937_64 random = RandomEngine(1000 + static_cast<std::uint64_t>(client));
      for (int i = 0; i < 60; ++i) {
        const auto bytes = SphereBytes(static_cast<int>(random() % 3), 4);
        const BuildKind build = core::kAllBuildKinds[random() % core::kAllBuildKinds.size()];
        const TreeId id{DigestOf(bytes), random() % 2 == 0 ? std::optional(build) : std::nullopt};
        switch (random() % 5) {
          case 0:
          case 1:
            EXPECT_TRUE(Upload(library_.get(), bytes, id.build).ok());
            break;
          case 2: {
            const auto loaded = library_->Load(id, Soon());
            EXPECT_TRUE(loaded.ok() || loaded.error().code == ErrorCode::kNotFound)
                << loaded.error().message;
            break;
          }
          case 3: {
            const core::Status status = library_->Delete(id);
            EXPECT_TRUE(status.ok() || status.error().code == ErrorCode::kNotFound);
            break;
          }
          default:
            for (const TreeInfo& info : library_->List(std::nullopt, std::nullopt, 100)) {
              (void)library_->Find(info.record.id);
            }
            break;
        }
      }
    });
  }
  for (std::thread& client : clients) client.join();
  for (const TreeInfo& info : library_->List(std::nullopt, std::nullopt, 100)) {
    EXPECT_TRUE(library_->Load(info.record.id, Soon()).ok());
    EXPECT_TRUE(library_->Delete(info.record.id).ok());
  }
  Settle();
  EXPECT_EQ(library_->counters().trees, 0u);
  EXPECT_EQ(library_->counters().memory_bytes, 0u);
  EXPECT_EQ(FilesIn("meshes") + FilesIn("catalog") + FilesIn("parsed") + FilesIn("trees"), 0u);
}

}  // namespace
}  // namespace kdray::test
