// SPDX-License-Identifier: Apache-2.0
#include "core/library/tree_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "core/library/memory_budget.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using std::chrono::milliseconds;

Sha256Digest Digest(int number) { return HashBytes(test::Bytes(std::to_string(number))); }

ParsedMesh SomeMesh() {
  Result<TriangleMesh> mesh = TriangleMesh::Create(test::Cube({0, 0, 0}, 1));
  return ParsedMesh{MeshFacts{}, *std::move(mesh)};
}

Tree SomeTree(BuildKind build) {
  Tree tree;
  tree.build = build;
  return tree;
}

class TreeCacheTest : public testing::Test {
 protected:
  TreeCacheTest() {
    budget_.set_reclaim([this](std::uint64_t bytes) { return cache_.EvictIdle(bytes); });
  }
  MemoryCharge Charge(std::uint64_t bytes) {
    std::optional<MemoryCharge> charge = budget_.TryReserve(bytes);
    EXPECT_TRUE(charge.has_value());
    return *std::move(charge);
  }
  void AddMesh(int number, std::uint64_t bytes) {
    cache_.InsertMesh(Digest(number), SomeMesh(), Charge(bytes));
  }
  void AddTree(int number, BuildKind build, std::uint64_t bytes) {
    cache_.InsertTree(Digest(number), SomeTree(build), Charge(bytes));
  }
  bool HasMesh(int number) { return cache_.FindMesh(Digest(number)) != nullptr; }
  bool HasTree(int number, BuildKind build) {
    return cache_.FindTree(Digest(number), build) != nullptr;
  }

  MemoryBudget budget_{1000};
  TreeCache cache_;
};

TEST_F(TreeCacheTest, FindsWhatWasInsertedUnderItsKeyOnly) {
  AddMesh(1, 100);
  AddTree(1, BuildKind::kBvh, 50);
  EXPECT_TRUE(HasMesh(1));
  EXPECT_FALSE(HasMesh(2));
  EXPECT_TRUE(HasTree(1, BuildKind::kBvh));
  EXPECT_FALSE(HasTree(1, BuildKind::kBox));
  EXPECT_FALSE(HasTree(2, BuildKind::kBvh));
  EXPECT_EQ(budget_.used(), 150u);
}

TEST_F(TreeCacheTest, LetsTheLeastRecentlyUsedGoFirst) {
  for (int i = 0; i < 5; ++i) AddMesh(i, 200);
  EXPECT_TRUE(HasMesh(0));  // now the most recently used
  AddMesh(5, 200);
  EXPECT_FALSE(HasMesh(1));
  AddMesh(6, 200);
  EXPECT_FALSE(HasMesh(2));
  for (const int i : {0, 3, 4, 5, 6}) EXPECT_TRUE(HasMesh(i)) << i;
  EXPECT_EQ(cache_.evictions(), 2u);
  EXPECT_EQ(budget_.used(), 1000u);
}

TEST_F(TreeCacheTest, LetsATreeGoBeforeTheMeshItNeeds) {
  AddMesh(1, 300);
  AddTree(1, BuildKind::kKdSah, 300);
  AddMesh(2, 300);
  EXPECT_TRUE(HasTree(1, BuildKind::kKdSah));  // a use of mesh 1 as well
  AddMesh(3, 200);
  EXPECT_FALSE(HasMesh(2));
  AddMesh(4, 300);
  EXPECT_FALSE(HasTree(1, BuildKind::kKdSah));
  EXPECT_TRUE(HasMesh(1));
}

TEST_F(TreeCacheTest, DoesNotLetGoOfWhatIsInUse) {
  AddMesh(1, 600);
  TreeCache::MeshPointer used = cache_.FindMesh(Digest(1));
  AddMesh(2, 400);
  EXPECT_FALSE(budget_.TryReserve(700).has_value()) << "only mesh 2 is idle";
  EXPECT_EQ(cache_.FindMesh(Digest(1)), used);
  used.reset();
  EXPECT_TRUE(budget_.TryReserve(1000).has_value());
  EXPECT_EQ(cache_.size(), 0u);
}

TEST_F(TreeCacheTest, WhatIsErasedInUseIsChargedUntilItsLastUserLetsGo) {
  AddMesh(1, 600);
  AddTree(1, BuildKind::kBox, 100);
  TreeCache::MeshPointer used = cache_.FindMesh(Digest(1));
  cache_.EraseMesh(Digest(1));
  EXPECT_EQ(cache_.size(), 0u) << "its trees go as well";
  EXPECT_EQ(budget_.used(), 600u);
  EXPECT_EQ(used->mesh.triangle_count(), 12u);
  used.reset();
  EXPECT_EQ(budget_.used(), 0u);
}

TEST_F(TreeCacheTest, ErasesOneTreeOrAMeshWithAllItsTreesAndNoOther) {
  for (const int mesh : {1, 2, 3}) {
    AddMesh(mesh, 10);
    for (const BuildKind build : kAllBuildKinds) AddTree(mesh, build, 10);
  }
  cache_.EraseTree(Digest(1), BuildKind::kBvh);
  EXPECT_FALSE(HasTree(1, BuildKind::kBvh));
  cache_.EraseMesh(Digest(2));
  EXPECT_EQ(cache_.size(), 6u + 7u);
  EXPECT_EQ(budget_.used(), 130u);
}

TEST_F(TreeCacheTest, ReplacesWhatHadTheKeyAndGivesItsChargeBack) {
  AddMesh(1, 400);
  AddMesh(1, 300);
  EXPECT_EQ(budget_.used(), 300u);
  EXPECT_EQ(cache_.size(), 1u);
}

TEST_F(TreeCacheTest, KeepsWithinTheBudgetWhateverHappens) {
  std::mt19937_64 random = test::RandomEngine(77);
  std::vector<TreeCache::MeshPointer> held;
  for (int i = 0; i < 3000; ++i) {
    const int key = static_cast<int>(random() % 20);
    const std::uint64_t bytes = random() % 400;
    switch (random() % 5) {
      case 0:
        if (auto charge = budget_.TryReserve(bytes)) {
          cache_.InsertMesh(Digest(key), SomeMesh(), std::move(*charge));
        }
        break;
      case 1:
        if (auto charge = budget_.TryReserve(bytes)) {
          cache_.InsertTree(Digest(key), SomeTree(BuildKind::kBvh), std::move(*charge));
        }
        break;
      case 2:
        if (auto mesh = cache_.FindMesh(Digest(key))) held.push_back(mesh);
        break;
      case 3:
        if (held.size() > 3) held.erase(held.begin());
        break;
      default:
        if (random() % 4 == 0) cache_.EraseMesh(Digest(key));
        break;
    }
    ASSERT_LE(budget_.used(), budget_.limit());
  }
  held.clear();
  cache_.EvictIdle(~std::uint64_t{0});
  EXPECT_EQ(budget_.used(), 0u);
  EXPECT_EQ(cache_.size(), 0u);
}

}  // namespace
}  // namespace kdray::core
