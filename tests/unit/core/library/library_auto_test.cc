// SPDX-License-Identifier: Apache-2.0
// The build that a TreeLibrary chooses for `auto`, and what of it survives.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/accel/auto_choice.h"
#include "core/accel/expected_cost.h"
#include "core/library/tree_library.h"
#include "core/store/catalog.h"
#include "tests/support/wait_until.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::AutoChoice;
using core::BuildKind;
using core::TreeId;
using core::TreeRecord;

// Needles one after the other along a diagonal: their boxes overlap, and are nearly empty, so a
// tree that cuts triangles culls more.
std::vector<std::byte> Needles(int count = 400) {
  core::MeshData data;
  for (int i = 0; i < count; ++i) {
    const double x = 10.0 * i / count;
    const auto first = static_cast<std::uint32_t>(data.vertices.size());
    data.vertices.push_back({x, x, 0});
    data.vertices.push_back({x + 3, x + 3, 0});
    data.vertices.push_back({x + 3.01, x + 2.99, 0});
    data.triangles.push_back({first, first + 1, first + 2});
  }
  return OffBytes(data);
}
std::vector<std::byte> Sphere() { return SphereBytes(1, 20); }

// Both trees, built without the library.
AutoChoice::Costs CostsOf(const core::TriangleMesh& mesh) {
  const auto cost = [&](BuildKind build) {
    return core::ExpectedCost(core::BuildTree(mesh, build).value()).value();
  };
  return {cost(BuildKind::kBvh), cost(BuildKind::kKdSah)};
}

class LibraryAutoTest : public LibraryTest {
 protected:
  LibraryAutoTest() { Open(); }
  TreeRecord RecordOf(const TreeId& id) { return library_->Find(id).value().record; }
};

TEST_F(LibraryAutoTest, AutoTakesTheTreeThatItsCostsFavour) {
  for (const auto& [bytes, expected] :
       {std::pair(Sphere(), BuildKind::kBvh), std::pair(Needles(), BuildKind::kKdSah)}) {
    const TreeId id = Add(bytes);
    const TreeRecord record = RecordOf(id);
    EXPECT_EQ(record.tree->build, expected);
    EXPECT_GT(record.tree->build_ms, 0);
    const core::Scene scene = library_->Load(id, Soon()).value();
    EXPECT_EQ(scene.tree->build, expected);
    EXPECT_EQ(record.tree->stats, scene.tree->stats);
    const AutoChoice::Costs costs = CostsOf(*scene.mesh);
    EXPECT_EQ(AutoChoice::kKdSahFactor * costs.kd_sah < costs.bvh, expected == BuildKind::kKdSah);
    ASSERT_TRUE(record.choice.has_value());
    EXPECT_EQ(record.choice->overlap, core::BoxOverlap(*scene.mesh).value());
    EXPECT_EQ(record.choice->costs.has_value(), !record.choice->OverlapsLittle());
    EXPECT_EQ(record.choice->costs.value_or(costs), costs);
  }
  EXPECT_EQ(library_->counters().builds, 3u) << "both for one of them";
}

TEST_F(LibraryAutoTest, NamedBuildsAndMeshesWithoutATreeHaveNoChoice) {
  EXPECT_FALSE(RecordOf(Add(Sphere(), BuildKind::kBvh)).choice.has_value());
  const TreeRecord cube = RecordOf(Add(OffBytes(Cube({0, 0, 0}, 1))));
  EXPECT_EQ(cube.tree->build, BuildKind::kBox);
  EXPECT_FALSE(cube.choice.has_value());
}

TEST_F(LibraryAutoTest, TheTreeThatWasNotTakenIsNotKept) {
  const TreeId id = Add(Needles());
  {
    const core::Scene scene = library_->Load(id, Soon()).value();
    const std::uint64_t kept = scene.mesh->bytes() + scene.tree->most_bytes();
    EXPECT_TRUE(WaitUntil([&] { return library_->counters().memory_bytes == kept; }));
  }  // a scene may not outlive its library, which Settle() opens again
  Settle();
  EXPECT_EQ(FilesIn("trees"), 1u);
}

TEST_F(LibraryAutoTest, TreesThatTheMeshHasAreComparedWithoutABuild) {
  Add(Needles(), BuildKind::kKdSah);
  Add(Needles(), BuildKind::kBvh);
  const TreeRecord record = RecordOf(Add(Needles()));
  EXPECT_EQ(record.tree->build, BuildKind::kKdSah);
  EXPECT_TRUE(record.choice->costs.has_value());
  EXPECT_EQ(library_->counters().builds, 2u);
}

TEST_F(LibraryAutoTest, AChoiceSurvivesARestartAndTheLossOfItsTree) {
  for (const auto& bytes : {Sphere(), Needles()}) {
    const TreeId id = Add(bytes);
    const auto answers = AnswersOf(library_.get(), id);
    const TreeRecord record = RecordOf(id);
    Settle();
    EXPECT_EQ(RecordOf(id), record);
    EXPECT_EQ(AnswersOf(library_.get(), id), answers);
    EXPECT_EQ(library_->counters().builds, 0u);
    EXPECT_EQ(RecordOf(id), record);

    library_.reset();
    disk_.Erase("data/trees/" + TreeId{id.mesh, record.tree->build}.ToString());
    Open();
    EXPECT_EQ(AnswersOf(library_.get(), id), answers);
    TreeRecord again = RecordOf(id);
    EXPECT_GT(library_->counters().builds, 0u);
    again.tree->build_ms = record.tree->build_ms;
    EXPECT_EQ(again, record) << "the same mesh, the same choice";
  }
}

// Older versions chose kd-sah, and wrote no reason.
TEST_F(LibraryAutoTest, ATreeOfAnOlderVersionIsWhatItWasUntilItIsBuiltAgain) {
  const TreeId named = Add(Sphere(), BuildKind::kKdSah);
  const TreeId automatic = Add(Sphere());
  const auto answers = AnswersOf(library_.get(), named);
  ASSERT_EQ(RecordOf(automatic).tree->build, BuildKind::kBvh);
  Settle();
  TreeRecord old = RecordOf(automatic);
  old.tree = RecordOf(named).tree;
  old.choice.reset();
  library_.reset();
  ASSERT_TRUE(core::Catalog(&disk_, "data/catalog").Save(old).ok());
  disk_.Erase("data/trees/" + TreeId{named.mesh, BuildKind::kBvh}.ToString());

  Open();
  EXPECT_EQ(RecordOf(automatic), old);
  EXPECT_EQ(AnswersOf(library_.get(), automatic), answers);
  EXPECT_EQ(library_->counters().builds, 0u);
  EXPECT_EQ(RecordOf(automatic), old);

  library_.reset();
  disk_.Erase("data/trees/" + named.ToString());
  Open();
  EXPECT_EQ(AnswersOf(library_.get(), automatic), answers);
  EXPECT_EQ(RecordOf(automatic).tree->build, BuildKind::kBvh);
  EXPECT_TRUE(RecordOf(automatic).choice.has_value());
}

TEST_F(LibraryAutoTest, ItsChoiceNeedsTheMemoryOfBothTrees) {
  const std::vector<std::byte> bytes = Needles(4'000);
  const TreeId id = Add(bytes);
  ASSERT_TRUE(RecordOf(id).choice->costs.has_value());
  std::uint64_t enough = 0;
  {
    const core::Scene scene = library_->Load(id, Soon()).value();
    const core::TriangleMesh& mesh = *scene.mesh;
    enough =
        mesh.bytes() + core::BuildTree(mesh, BuildKind::kBvh).value().most_bytes() +
        std::max(core::EstimateBuildBytes(mesh.triangle_count(), BuildKind::kKdSah),
                 core::EstimateFinishBytes(core::BuildBinaryTree(mesh, BuildKind::kKdSah).value()));
  }
  for (const std::uint64_t limit : {enough, enough - 1}) {
    ASSERT_TRUE(library_->Delete(id).ok());
    options_.memory_limit_bytes = limit;
    Open();
    const auto added = Upload(library_.get(), bytes);
    ASSERT_TRUE(added.ok());
    const auto loaded = library_->Load(added->id, Soon());
    if (limit == enough) {
      EXPECT_TRUE(loaded.ok()) << loaded.error().message;
    } else {
      ASSERT_FALSE(loaded.ok());
      EXPECT_EQ(loaded.error().code, core::ErrorCode::kMeshTooLarge);
    }
  }
}

}  // namespace
}  // namespace kdray::test
