// SPDX-License-Identifier: Apache-2.0
#include "core/store/catalog.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "core/base/hash.h"
#include "core/store/checked_file.h"
#include "core/store/facts_codec.h"
#include "tests/support/mesh_files.h"
#include "tests/support/simulated_disk.h"

namespace kdray::core {
namespace {

using test::Bytes;
using test::SimulatedDisk;

TreeRecord PendingRecord(std::string_view mesh, std::optional<BuildKind> build) {
  TreeRecord record;
  record.id = {HashBytes(Bytes(mesh)), build};
  record.created_ms = 1'700'000'000'123;
  record.mesh_bytes = 4711;
  record.resumed = 1;
  return record;
}

TreeRecord ReadyRecord(std::string_view mesh) {
  TreeRecord record = PendingRecord(mesh, std::nullopt);
  MeshFacts facts;
  facts.format = MeshFormat::kStl;
  facts.file_bytes = 4711;
  facts.triangles = 12;
  facts.vertices = 8;
  facts.bounds = {{-1, -2, -3}, {1, 2, 3}};
  facts.health.closed = true;
  facts.frame = {{100, 0, -5}, -3};
  facts.double_vertices = true;
  facts.wider_than_declared = true;
  facts.rounded_vertices = true;
  facts.shortest_edge = 0.125;
  facts.parse_ms = 1.5;
  facts.area = 0.75;
  facts.volume = -0.5;
  facts.groups = 3;
  record.mesh = facts;
  TreeFacts tree;
  tree.build = BuildKind::kBox;
  tree.stats.nodes = 1;
  tree.stats.leaf_histogram = {0, 0, 0, 1};
  tree.stats.max_leaf = 3;
  tree.stats.sah_cost = 12.5;
  tree.build_ms = 0.25;
  record.tree = tree;
  record.choice = {7.5, AutoChoice::Costs{12.5, 10.25}};
  return record;
}

// As versions 2 and 3 recorded it.
TreeRecord WithoutSurfaceFacts(TreeRecord record) {
  record.choice.reset();
  record.mesh->area.reset();
  record.mesh->volume.reset();
  record.mesh->groups.reset();
  return record;
}

class CatalogTest : public testing::Test {
 protected:
  CatalogTest() : catalog_(&disk_, "catalog") { EXPECT_TRUE(catalog_.Open().ok()); }
  Catalog::Contents Load() {
    Result<Catalog::Contents> contents = catalog_.Load();
    EXPECT_TRUE(contents.ok());
    std::sort(contents->records.begin(), contents->records.end(),
              [](const TreeRecord& a, const TreeRecord& b) { return a.id < b.id; });
    return *std::move(contents);
  }
  static std::string FileOf(const TreeRecord& record) { return "catalog/" + record.id.ToString(); }

  SimulatedDisk disk_;
  Catalog catalog_;
};

TEST_F(CatalogTest, GivesBackWhatWasSaved) {
  std::vector<TreeRecord> saved = {ReadyRecord("a"), PendingRecord("a", BuildKind::kBvh),
                                   PendingRecord("b", BuildKind::kKdSah)};
  for (const TreeRecord& record : saved) ASSERT_TRUE(catalog_.Save(record).ok());
  std::sort(saved.begin(), saved.end(),
            [](const TreeRecord& a, const TreeRecord& b) { return a.id < b.id; });
  const Catalog::Contents contents = Load();
  EXPECT_EQ(contents.records, saved);
  EXPECT_EQ(contents.damaged, 0u);
}

TEST_F(CatalogTest, KeepsTheNamesOfGroupsUntilTheMeshGoes) {
  const Sha256Digest mesh = HashBytes(Bytes("a"));
  EXPECT_EQ(catalog_.ReadGroupNames(mesh).error().code, ErrorCode::kNotFound);
  const std::vector<std::string> names = {"", "left wing", "left wing"};
  ASSERT_TRUE(catalog_.SaveGroupNames(mesh, names).ok());
  EXPECT_EQ(*catalog_.ReadGroupNames(mesh), names);
  EXPECT_TRUE(Load().records.empty());  // it is no record
  ASSERT_TRUE(catalog_.RemoveAllOf(mesh).ok());
  EXPECT_EQ(catalog_.ReadGroupNames(mesh).error().code, ErrorCode::kNotFound);
}

TEST_F(CatalogTest, GivesBackWhyAutoChoseABuild) {
  TreeRecord record = ReadyRecord("a");
  for (const std::optional<AutoChoice>& choice :
       {std::optional<AutoChoice>(), std::optional(AutoChoice{0.5, std::nullopt}),
        std::optional(AutoChoice{1e300, AutoChoice::Costs{0.1, 0.3}})}) {
    record.choice = choice;
    ASSERT_TRUE(catalog_.Save(record).ok());
    EXPECT_THAT(Load().records, testing::ElementsAre(record));
  }
}

// Version 4 did not tell why.
TEST_F(CatalogTest, ARecordOfVersion4HasNoChoice) {
  TreeRecord record = ReadyRecord("a");
  BlobStore blobs(&disk_, "catalog");
  CheckedWriter writer(blobs.Create().value(), FileKind{"kdraycat", 4});
  const std::string name = record.id.ToString();
  writer.PutArray(std::span(name));
  writer.Put(record.created_ms);
  writer.Put(record.mesh_bytes);
  writer.Put(record.resumed);
  PutBool(true, &writer);
  PutMeshFacts(*record.mesh, &writer);
  PutSurfaceFacts(*record.mesh, &writer);
  PutBool(true, &writer);
  PutEnum(record.tree->build, &writer);
  PutTreeStats(record.tree->stats, &writer);
  writer.Put(record.tree->build_ms);
  ASSERT_TRUE(std::move(writer).Finish()->Commit(name).ok());
  record.choice.reset();
  EXPECT_THAT(Load().records, testing::ElementsAre(record));
}

// Version 3 did not tell area, volume and groups.
TEST_F(CatalogTest, ARecordOfVersion3HasNoFactsAboutTheSurface) {
  TreeRecord record = ReadyRecord("a");
  BlobStore blobs(&disk_, "catalog");
  CheckedWriter writer(blobs.Create().value(), FileKind{"kdraycat", 3});
  const std::string name = record.id.ToString();
  writer.PutArray(std::span(name));
  writer.Put(record.created_ms);
  writer.Put(record.mesh_bytes);
  writer.Put(record.resumed);
  PutBool(true, &writer);
  PutMeshFacts(*record.mesh, &writer);
  PutBool(true, &writer);
  PutEnum(record.tree->build, &writer);
  PutTreeStats(record.tree->stats, &writer);
  writer.Put(record.tree->build_ms);
  ASSERT_TRUE(std::move(writer).Finish()->Commit(name).ok());
  EXPECT_THAT(Load().records, testing::ElementsAre(WithoutSurfaceFacts(record)));
}

// Version 2 did not tell max_leaf and `resumed`.
void SaveAsVersion2(const TreeRecord& record, SimulatedDisk* disk) {
  BlobStore blobs(disk, "catalog");
  CheckedWriter writer(blobs.Create().value(), FileKind{"kdraycat", 2});
  const std::string name = record.id.ToString();
  writer.PutArray(std::span(name));
  writer.Put(record.created_ms);
  writer.Put(record.mesh_bytes);
  PutBool(true, &writer);
  PutMeshFacts(record.mesh.value(), &writer);
  PutBool(true, &writer);
  PutEnum(record.tree->build, &writer);
  const TreeStats& stats = record.tree->stats;
  writer.Put(stats.nodes);
  writer.Put(stats.leaves);
  writer.Put(stats.empty_leaves);
  writer.Put(stats.references);
  writer.Put(stats.max_depth);
  writer.PutArray(std::span(stats.leaf_histogram));
  writer.Put(stats.bytes);
  writer.Put(stats.sah_cost);
  writer.Put(stats.traversal_cost);
  writer.Put(stats.intersection_cost);
  writer.Put(record.tree->build_ms);
  ASSERT_TRUE(std::move(writer).Finish()->Commit(name).ok());
}

TEST_F(CatalogTest, ARecordOfVersion2HasTheLargestLeafThatItsHistogramTells) {
  TreeRecord record = WithoutSurfaceFacts(ReadyRecord("a"));
  record.resumed = 0;
  std::vector<std::uint64_t>& histogram = record.tree->stats.leaf_histogram;
  for (const std::size_t largest : {0u, 3u, 64u, 66u, 100'000u}) {
    histogram.assign(largest + 1, 0);
    histogram[largest] = 2;
    if (largest > 66) histogram[65] = 1;
    SaveAsVersion2(record, &disk_);
    TreeRecord expected = record;
    expected.tree->stats.max_leaf = largest;
    if (largest > 65) {
      expected.tree->stats.leaf_histogram.resize(66);
      expected.tree->stats.leaf_histogram[65] = largest > 66 ? 3 : 2;
    }
    const Catalog::Contents contents = Load();
    EXPECT_THAT(contents.records, testing::ElementsAre(expected)) << largest;
    EXPECT_EQ(contents.damaged, 0u);
  }
}

TEST_F(CatalogTest, ARecordOfVersion2WithACappedHistogramIsDueForABuild) {
  TreeRecord record = WithoutSurfaceFacts(ReadyRecord("a"));
  record.resumed = 0;
  record.tree->stats.leaf_histogram.assign(66, 1);
  SaveAsVersion2(record, &disk_);
  record.tree.reset();
  const Catalog::Contents contents = Load();
  EXPECT_THAT(contents.records, testing::ElementsAre(record));
  EXPECT_EQ(contents.damaged, 0u);
}

TEST_F(CatalogTest, ARecordOfVersion1KeepsItsAgeAndIsDueForABuild) {
  TreeRecord record = PendingRecord("a", BuildKind::kBvh);
  record.resumed = 0;
  BlobStore blobs(&disk_, "catalog");
  CheckedWriter writer(blobs.Create().value(), FileKind{"kdraycat", 1});
  const std::string name = record.id.ToString();
  writer.PutArray(std::span(name));
  writer.Put(record.created_ms);
  writer.Put(record.mesh_bytes);
  writer.PutArray(std::span<const std::uint64_t>(std::vector<std::uint64_t>(100'001)));
  ASSERT_TRUE(std::move(writer).Finish()->Commit(name).ok());
  const std::vector<std::byte> good = disk_.Contents(FileOf(record)).value();
  EXPECT_THAT(Load().records, testing::ElementsAre(record));
  EXPECT_EQ(Load().damaged, 0u);
  for (const std::size_t i : {std::size_t{100}, std::size_t{5000}, good.size() - 50}) {
    std::vector<std::byte> bad = good;
    bad[i] ^= std::byte{4};
    disk_.SetContents(FileOf(record), bad);
    EXPECT_EQ(Load().damaged, 1u) << "what is passed over is checked too";
  }
}

TEST_F(CatalogTest, ARecordOfALaterVersionIsNotRead) {
  const TreeRecord record = PendingRecord("a", BuildKind::kBvh);
  ASSERT_TRUE(catalog_.Save(record).ok());
  std::vector<std::byte> bytes = disk_.Contents(FileOf(record)).value();
  bytes[8] = std::byte{6};
  const Sha256Digest digest = HashBytes(std::span<const std::byte>(bytes).first(bytes.size() - 32));
  std::memcpy(bytes.data() + bytes.size() - 32, digest.bytes.data(), 32);
  disk_.SetContents(FileOf(record), bytes);
  EXPECT_EQ(Load().damaged, 1u);
}

TEST_F(CatalogTest, ReplacesAndRemoves) {
  TreeRecord record = PendingRecord("a", std::nullopt);
  ASSERT_TRUE(catalog_.Save(record).ok());
  record = ReadyRecord("a");
  ASSERT_TRUE(catalog_.Save(record).ok());
  EXPECT_THAT(Load().records, testing::ElementsAre(record));
  ASSERT_TRUE(catalog_.Remove(record.id).ok());
  EXPECT_THAT(Load().records, testing::IsEmpty());
}

TEST_F(CatalogTest, PassesOverNamesThatAreNoId) {
  const TreeRecord record = WithoutSurfaceFacts(ReadyRecord("a"));
  ASSERT_TRUE(catalog_.Save(record).ok());
  const std::string id = record.id.ToString();
  for (const std::string& name :
       {std::string("junk"), std::string("core"), id + "x", id.substr(0, 64), id.substr(1),
        id.substr(0, 65) + "octree", id.substr(0, 65), std::string("A") + id.substr(1),
        std::string("lost+found"), id + "~"}) {
    disk_.SetContents("catalog/" + name, Bytes("junk"));
  }
  const Catalog::Contents contents = Load();
  EXPECT_THAT(contents.records, testing::ElementsAre(record));
  EXPECT_EQ(contents.damaged, 0u);
}

TEST_F(CatalogTest, ADamagedFileStillTellsThatTheTreeIsWanted) {
  const TreeRecord good = ReadyRecord("a");
  ASSERT_TRUE(catalog_.Save(good).ok());
  const std::vector<std::byte> bytes = disk_.Contents(FileOf(good)).value();
  const auto expect_due = [&](const std::string& what) {
    const Catalog::Contents contents = Load();
    ASSERT_EQ(contents.records.size(), 1u) << what;
    EXPECT_EQ(contents.records[0].id, good.id) << what;
    EXPECT_FALSE(contents.records[0].tree.has_value()) << what;
    EXPECT_GT(contents.records[0].created_ms, 0) << what;
    EXPECT_EQ(contents.damaged, 1u) << what;
  };
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::vector<std::byte> bad = bytes;
    bad[i] ^= std::byte{1} << (i % 8);
    disk_.SetContents(FileOf(good), bad);
    expect_due("byte " + std::to_string(i));
  }
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    disk_.SetContents(FileOf(good),
                      {bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length)});
    expect_due("cut to " + std::to_string(length));
  }
  disk_.SetContents(FileOf(good), bytes);
  disk_.MakeUnreadable(FileOf(good));
  expect_due("a link");
}

TEST_F(CatalogTest, AFileUnderAnotherTreesNameIsNotBelieved) {
  const TreeRecord a = ReadyRecord("a");
  const TreeRecord b = PendingRecord("b", BuildKind::kBvh);
  ASSERT_TRUE(catalog_.Save(a).ok());
  disk_.SetContents(FileOf(b), disk_.Contents(FileOf(a)).value());
  const Catalog::Contents contents = Load();
  EXPECT_EQ(contents.damaged, 1u);
  ASSERT_EQ(contents.records.size(), 2u);
  for (const TreeRecord& record : contents.records) {
    EXPECT_EQ(record.tree.has_value(), record.id == a.id);
  }
}

TEST_F(CatalogTest, AnErrorOfTheDiskLosesNoRecord) {
  const TreeRecord record = WithoutSurfaceFacts(ReadyRecord("a"));
  ASSERT_TRUE(catalog_.Save(record).ok());
  disk_.FailAt(0, ErrorCode::kIo);
  EXPECT_FALSE(catalog_.Load().ok()) << "a folder that cannot be listed is not an empty one";
  for (std::uint64_t n = 1; n < 4; ++n) {
    disk_.FailAt(n, ErrorCode::kIo);
    const Catalog::Contents contents = Load();
    ASSERT_EQ(contents.records.size(), 1u) << "operation " << n;
    EXPECT_EQ(contents.damaged, 1u);
  }
}

TEST_F(CatalogTest, ACrashDuringASaveLeavesTheOldRecordOrTheNew) {
  const TreeRecord old_record = PendingRecord("a", std::nullopt);
  const TreeRecord new_record = ReadyRecord("a");
  for (std::uint64_t n = 0; n < 6; ++n) {
    for (const auto loss : {SimulatedDisk::Loss::kNothing, SimulatedDisk::Loss::kContents,
                            SimulatedDisk::Loss::kEverything}) {
      SimulatedDisk disk;
      Catalog catalog(&disk, "catalog");
      ASSERT_TRUE(catalog.Open().ok());
      ASSERT_TRUE(catalog.Save(old_record).ok());
      disk.DieAt(n);
      (void)catalog.Save(new_record);
      disk.Restart(loss);
      Catalog again(&disk, "catalog");
      ASSERT_TRUE(again.Open().ok());
      const Result<Catalog::Contents> contents = again.Load();
      ASSERT_TRUE(contents.ok());
      EXPECT_EQ(contents->damaged, 0u) << "operation " << n;
      ASSERT_EQ(contents->records.size(), 1u);
      EXPECT_TRUE(contents->records[0] == old_record || contents->records[0] == new_record);
    }
  }
}

}  // namespace
}  // namespace kdray::core
