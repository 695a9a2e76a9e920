// SPDX-License-Identifier: Apache-2.0
// Attributes of stored meshes: read when they are first named, once for all who ask, and dropped
// with their mesh.
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "core/library/attribute_loader.h"
#include "core/library/tree_library.h"
#include "tests/support/wait_until.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::core {
namespace {

using std::chrono::milliseconds;

// A square in two groups with texture coordinates, many times.
std::vector<std::byte> Squares(int count) {
  std::string text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
  for (int i = 0; i < count; ++i) {
    text += i % 2 == 0 ? "g even\n" : "g odd\n";
    text += "f 1/1 2/2 3/3 4/4\n";
  }
  return test::Bytes(text);
}

// One triangle, and very many texture coordinates that it does not use.
std::vector<std::byte> LongFile(int count) {
  std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/1\n";
  for (int i = 0; i < count; ++i) text += "vt 0.25 0.125\n";
  return test::Bytes(text);
}

class LibraryAttributes : public test::LibraryTest {
 protected:
  LibraryAttributes() { Open(); }

  std::shared_ptr<const MeshAttributes> MustLoad(const TreeId& id, AttributeKinds kinds) {
    const auto attributes = library_->LoadAttributes(id, kinds, test::Soon());
    EXPECT_TRUE(attributes.ok()) << attributes.error().message;
    return attributes.ok() ? *attributes : nullptr;
  }
};

TEST_F(LibraryAttributes, AreReadOnlyWhenTheyAreNamedAndThenKept) {
  const TreeId id = Add(Squares(3));
  test::AnswersOf(library_.get(), id);
  EXPECT_EQ(library_->counters().attribute_reads, 0u);
  const auto groups = MustLoad(id, {AttributeKind::kGroup});
  EXPECT_EQ(groups->Group(2), 1);
  EXPECT_FALSE(groups->has(AttributeKind::kUv));
  EXPECT_EQ(MustLoad(id, {AttributeKind::kGroup}), groups);
  EXPECT_EQ(library_->counters().attribute_reads, 1u);
  // Another kind is read together with those that are there.
  const auto both = MustLoad(id, {AttributeKind::kUv});
  EXPECT_EQ(both->Uv(1, 1, 0)[1], 1);
  EXPECT_EQ(both->Group(2), 1);
  EXPECT_EQ(MustLoad(id, {AttributeKind::kGroup}), both);
  EXPECT_EQ(library_->counters().attribute_reads, 2u);
}

TEST_F(LibraryAttributes, OfAMeshWithoutThemTakeNoMemoryThatGrows) {
  const TreeId id = Add(test::SphereBytes(1, 10));
  Settle();
  test::AnswersOf(library_.get(), id);
  const std::uint64_t before = library_->counters().memory_bytes;
  const auto attributes =
      MustLoad(id, {AttributeKind::kUv, AttributeKind::kShadingNormal, AttributeKind::kColor,
                    AttributeKind::kGroup, AttributeKind::kEdges});
  EXPECT_LE(library_->counters().memory_bytes, before + 1024);
  EXPECT_EQ(attributes->bytes(), MeshAttributes().bytes());
}

TEST_F(LibraryAttributes, AreSharedByTheBuildsOfAMeshAndDroppedWithIt) {
  const std::vector<std::byte> bytes = Squares(200);
  const std::uint64_t before = library_->counters().memory_bytes;
  const TreeId first = Add(bytes);
  const TreeId second = Add(bytes, BuildKind::kBvh);
  EXPECT_EQ(MustLoad(first, {AttributeKind::kUv}), MustLoad(second, {AttributeKind::kUv}));
  ASSERT_TRUE(library_->Delete(first).ok());
  MustLoad(second, {AttributeKind::kUv});
  EXPECT_EQ(library_->counters().attribute_reads, 1u);
  ASSERT_TRUE(library_->Delete(second).ok());
  // The workers that built and read may hold what they made a little longer.
  EXPECT_TRUE(test::WaitUntil([&] { return library_->counters().memory_bytes == before; }));
  const auto gone = library_->LoadAttributes(second, {AttributeKind::kUv}, test::Soon());
  ASSERT_FALSE(gone.ok());
  EXPECT_EQ(gone.error().code, ErrorCode::kNotFound);
}

TEST_F(LibraryAttributes, AreReadOnceForAllWhoAskAtTheSameTime) {
  const TreeId id = Add(LongFile(50'000));
  std::vector<std::shared_ptr<const MeshAttributes>> results(4);
  std::vector<std::thread> threads;
  for (auto& result : results) {
    threads.emplace_back([&] { result = MustLoad(id, {AttributeKind::kUv}); });
  }
  for (std::thread& thread : threads) thread.join();
  for (const auto& result : results) EXPECT_EQ(result, results[0]);
  EXPECT_EQ(library_->counters().attribute_reads, 1u);
}

TEST_F(LibraryAttributes, AreRefusedWhenMemoryIsFull) {
  const std::vector<std::byte> bytes = Squares(2000);
  auto store = SceneStore::Open({&disk_, "other", std::nullopt});
  ASSERT_TRUE(store.ok());
  ASSERT_TRUE((*store)->Load().ok());
  MemoryBudget budget(bytes.size() / 2);
  TreeCache cache;
  AttributeLoader loader({store->get(), &cache, &budget, [](const Sha256Digest&) {}});
  const auto refused =
      loader.Load(HashBytes(bytes), bytes.size(), {AttributeKind::kUv}, test::Soon());
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::kMemoryFull);
  EXPECT_EQ(budget.used(), 0u);
  EXPECT_EQ(loader.reads(), 0u);
}

TEST_F(LibraryAttributes, StopSoonAfterTheLastWhoAskedHasLeft) {
  const TreeId id = Add(LongFile(500'000));
  for (const milliseconds after : {milliseconds(0), milliseconds(5)}) {
    const auto start = std::chrono::steady_clock::now();
    const auto late = library_->LoadAttributes(id, {AttributeKind::kUv}, test::Within(after));
    EXPECT_LT(std::chrono::steady_clock::now() - start, after + milliseconds(250));
    if (late.ok()) continue;
    EXPECT_EQ(late.error().code, ErrorCode::kDeadlineExceeded);
  }
  EXPECT_NE(MustLoad(id, {AttributeKind::kUv}), nullptr);
}

TEST_F(LibraryAttributes, TheNamesOfGroupsNeedNoReadingOfTheMesh) {
  const TreeId id = Add(Squares(3));
  EXPECT_EQ(library_->Find(id)->record.mesh->groups, 2u);
  const std::vector<std::string> names = {"even", "odd"};
  EXPECT_EQ(*library_->GroupNames(id, test::Soon()), names);
  Settle();
  EXPECT_EQ(library_->Find(id)->record.mesh->groups, 2u);
  EXPECT_EQ(library_->Find(id)->record.mesh->area, 3.0);
  EXPECT_EQ(library_->Find(id)->record.mesh->volume, std::nullopt);
  EXPECT_EQ(*library_->GroupNames(id, test::Soon()), names);
  EXPECT_EQ(library_->counters().attribute_reads, 0u);
  // Without their file they are read from the mesh.
  ASSERT_TRUE(disk_.Remove("data/catalog/" + id.mesh.ToHex() + "-groups").ok());
  EXPECT_EQ(*library_->GroupNames(id, test::Soon()), names);
  EXPECT_EQ(library_->counters().attribute_reads, 1u);
  ASSERT_TRUE(library_->Delete(id).ok());
  EXPECT_EQ(FilesIn("catalog"), 0u);
}

TEST_F(LibraryAttributes, AreNotReadAfterTheShutdown) {
  const TreeId id = Add(Squares(3));
  library_->Shutdown();
  const auto attributes = library_->LoadAttributes(id, {AttributeKind::kUv}, test::Soon());
  ASSERT_FALSE(attributes.ok());
}

}  // namespace
}  // namespace kdray::core
