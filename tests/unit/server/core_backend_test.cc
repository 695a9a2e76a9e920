// SPDX-License-Identifier: Apache-2.0
// The backend in the contract's words, on real meshes and a disk of its own: uploads, builds,
// lists, deletion, its end.
#include "server/core_backend.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "core/base/hash.h"
#include "tests/support/mesh_files.h"
#include "tests/unit/server/core_backend_fixture.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
using testing::HasSubstr;

TEST_F(CoreBackendTest, AnUploadIsDescribedAndItsBytesComeBack) {
  const MeshBytesVector bytes = test::OffBytes(Sphere());
  const std::string sha256 = core::HashBytes(bytes).ToHex();
  const auto stored = Upload(bytes, api::Build::kKdBinned);
  ASSERT_TRUE(stored.ok());
  EXPECT_EQ(stored->id, sha256 + "-kd-binned");
  EXPECT_FALSE(stored->existed);
  const auto description =
      backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(2), CancelToken());
  ASSERT_TRUE(description.ok());
  EXPECT_TRUE(description->ready);
  EXPECT_EQ(description->progress, 1.0);
  EXPECT_EQ(description->mesh.sha256, sha256);
  EXPECT_EQ(description->mesh.format, api::MeshFormat::kOff);
  EXPECT_EQ(description->mesh.bytes, bytes.size());
  EXPECT_EQ(description->mesh.triangles, Sphere().triangles.size());
  EXPECT_TRUE(description->mesh.health.closed);
  ASSERT_TRUE(description->tree.has_value());
  EXPECT_EQ(description->tree->build, api::Build::kKdBinned);
  EXPECT_THAT(description->plan, HasSubstr("kd-binned"));
  EXPECT_TRUE(Upload(bytes, api::Build::kKdBinned)->existed);

  const auto mesh = backend_->OpenMesh(stored->id, {});
  ASSERT_TRUE(mesh.ok());
  MeshBytesVector read((*mesh)->size());
  ASSERT_TRUE((*mesh)->Read(0, read));
  EXPECT_EQ(read, bytes);
  EXPECT_FALSE((*mesh)->Read(read.size(), std::span(read).first(1))) << "beyond the end";
}

TEST_F(CoreBackendTest, WhatIsNoIdIsNotFoundEverywhere) {
  const std::string real = Add(Sphere());
  for (const std::string& id :
       {std::string(), std::string("x"), std::string("../") + real, real + "x", real.substr(0, 64),
        real.substr(0, 65), std::string(64, 'g') + "-auto", std::string(64, 'A') + "-auto",
        std::string(64, '0') + "-auto", real.substr(0, 65) + "octree", real + std::string(1, '\0'),
        std::string(5000, 'a')}) {
    EXPECT_EQ(DescribeNow(id).problem().code, ErrorCode::kTreeNotFound) << id;
    EXPECT_EQ(backend_->Delete(id)->code, ErrorCode::kTreeNotFound);
    EXPECT_EQ(backend_->OpenMesh(id, {}).problem().code, ErrorCode::kTreeNotFound);
    EXPECT_EQ(Closest(id, SomeRays<double>(1).table(), {}, Soon()).problem().code,
              ErrorCode::kTreeNotFound);
    EXPECT_EQ(Any(id, SomeRays<double>(1).table(), {}, Soon()).problem().code,
              ErrorCode::kTreeNotFound);
    EXPECT_EQ(Render(id, {}, true, Soon()).problem().code, ErrorCode::kTreeNotFound);
    EXPECT_EQ(Cells(id, 0, Soon()).problem().code, ErrorCode::kTreeNotFound);
  }
}

TEST_F(CoreBackendTest, AnotherBuildOfAStoredMesh) {
  const std::string id = Add(Sphere());
  const std::string sha256 = id.substr(0, 64);
  const auto stored = backend_->BuildStored(sha256, api::Build::kBvh);
  ASSERT_TRUE(stored.ok());
  EXPECT_EQ(stored->id, sha256 + "-bvh");
  EXPECT_FALSE(stored->existed);
  for (const std::string& unknown : {std::string(64, '0'), std::string("x"), sha256 + "0"}) {
    EXPECT_EQ(backend_->BuildStored(unknown, api::Build::kBvh).problem().code,
              ErrorCode::kMeshNotFound);
  }
}

TEST_F(CoreBackendTest, BrokenMeshesAnswerTheirProblemWithItsLine) {
  const auto stored = Upload(test::Bytes("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"));
  ASSERT_TRUE(stored.ok());
  const auto waited =
      backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(2), CancelToken());
  ASSERT_FALSE(waited.ok());
  EXPECT_EQ(waited.problem().code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(waited.problem().line, 6u);
  EXPECT_EQ(DescribeNow(stored->id).problem().code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(Closest(stored->id, SomeRays<double>(1).table(), {}, Soon()).problem().code,
            ErrorCode::kInvalidMesh);
  EXPECT_EQ(Upload({}).problem().code, ErrorCode::kEmptyMesh);
}

TEST_F(CoreBackendTest, AQueryOnATreeThatIsBuiltWaitsItsDeadlineOutAndIsToldToComeAgain) {
  // Large enough that it is not built at once.
  const auto stored = Upload(test::OffBytes(test::UvSphere({0, 0, 0}, 1, 80, 160)));
  ASSERT_TRUE(stored.ok());
  const auto building = DescribeNow(stored->id);
  ASSERT_TRUE(building.ok());
  const auto hasty = Closest(stored->id, SomeRays<double>(1).table(), {},
                             CancelToken::WithDeadline(steady_clock::now() + milliseconds(1)));
  // The build may end just after the deadline.
  const bool built_late = !hasty.ok() && hasty.problem().code == ErrorCode::kDeadlineExceeded;
  EXPECT_TRUE(!built_late || DescribeNow(stored->id)->ready);
  if (!building->ready && !hasty.ok() && !built_late) {
    EXPECT_EQ(hasty.problem().code, ErrorCode::kTreeBuilding);
    EXPECT_THAT(hasty.problem().detail, HasSubstr("percent of the work is done"));
    EXPECT_LT(building->progress, 1.0);
    EXPECT_FALSE(building->tree.has_value());
    EXPECT_EQ(building->mesh.sha256, stored->id.substr(0, 64));
  }
  EXPECT_TRUE(Closest(stored->id, SomeRays<double>(1).table(), {}, Soon()).ok());
}

TEST_F(CoreBackendTest, AnAcquiredTreeAnswersAfterItWasDeleted) {
  const std::string id = Add(Sphere());
  EXPECT_EQ(backend_->Find(id), std::nullopt);
  const auto tree = backend_->Acquire(id, TreeUse::kRays, Soon());
  ASSERT_TRUE(tree.ok());
  const auto ask = [&] {
    test::Collected<api::ClosestRows> rows;
    EXPECT_TRUE((*tree)->Closest(SomeRays<double>(100).table(), {}, Soon(), &rows).ok());
    return rows.hits;
  };
  const std::vector<api::RayHit> before = ask();
  EXPECT_EQ(backend_->Delete(id), std::nullopt);
  EXPECT_EQ(backend_->Find(id)->code, ErrorCode::kTreeNotFound);
  EXPECT_EQ(backend_->Acquire(id, TreeUse::kRays, Soon()).problem().code, ErrorCode::kTreeNotFound);
  const std::vector<api::RayHit> after = ask();
  for (std::size_t i = 0; i < 100; ++i) {
    EXPECT_EQ(after[i].triangle, before[i].triangle) << i;
  }
}

TEST_F(CoreBackendTest, PagesOfTheListJoinWithoutGaps) {
  std::vector<std::string> ids;
  for (int i = 0; i < 5; ++i) ids.push_back(Add(test::Cube({double(i), 0, 0}, 1)));
  std::vector<std::string> listed;
  std::string after;
  for (int pages = 0; pages < 10; ++pages) {
    const auto page = backend_->List("", 2, after);
    ASSERT_TRUE(page.ok());
    for (const auto& tree : page->trees) listed.push_back(tree.id);
    if (!page->next) break;
    after = *page->next;
  }
  EXPECT_THAT(listed, testing::UnorderedElementsAreArray(ids));
  EXPECT_FALSE(backend_->List("", 5, "")->next.has_value()) << "all of them fit";
  const auto one = backend_->List(ids[2].substr(0, 64), 10, "");
  ASSERT_EQ(one->trees.size(), 1u);
  EXPECT_EQ(one->trees[0].id, ids[2]);
  EXPECT_TRUE(backend_->List(std::string(64, '0'), 10, "")->trees.empty());
  for (const std::string& bad : {std::string("x"), std::string("1"), after + "x"}) {
    const auto refused = backend_->List("", 2, bad);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.problem().code, ErrorCode::kInvalidParameter);
    EXPECT_EQ(refused.problem().parameter, "after");
  }
}

TEST_F(CoreBackendTest, AnswersAreTheSameBytesFromMemoryDiskAndEveryThreadCount) {
  const std::string id = Add(Sphere());
  const test::RayRows<double> rays = SomeRays<double>(20'000);
  const auto before = Closest(id, rays.table(), {}, Soon());
  ASSERT_TRUE(before.ok());
  for (const int threads : {1, 2, 5}) {
    options_.threads = threads;
    Open();
    const auto after = Closest(id, rays.table(), {}, Soon());
    ASSERT_TRUE(after.ok());
    for (std::size_t i = 0; i < rays.table().size(); ++i) {
      ExpectSame(before->rows->hits[i], after->rows->hits[i]);
    }
    EXPECT_EQ(backend_->counters().builds, 0u);
    EXPECT_EQ(backend_->counters().loads, 1u);
  }
}

TEST_F(CoreBackendTest, AFullDiskIsStoreFullAndWhatIsInMemoryIsServed) {
  const std::string id = Add(Sphere());
  disk_.set_read_only(true);
  EXPECT_EQ(backend_->BeginUpload(100).problem().code, ErrorCode::kStoreFull);
  EXPECT_TRUE(Closest(id, SomeRays<double>(10).table(), {}, Soon()).ok());
  EXPECT_EQ(backend_->Delete(id)->code, ErrorCode::kStoreFull);
}

TEST_F(CoreBackendTest, ShutdownEndsWaitsAndAnswersDraining) {
  const auto stored = Upload(test::OffBytes(test::UvSphere({0, 0, 0}, 1, 80, 160)));
  ASSERT_TRUE(stored.ok());
  std::thread client([&] {
    const auto waited = backend_->Describe(
        stored->id, steady_clock::now() + std::chrono::minutes(2), CancelToken());
    EXPECT_TRUE(waited.ok() || waited.problem().code == ErrorCode::kDraining);
  });
  const auto start = steady_clock::now();
  backend_->Shutdown();
  client.join();
  EXPECT_LT(steady_clock::now() - start, std::chrono::seconds(20));
  Open();
  EXPECT_TRUE(Closest(stored->id, SomeRays<double>(1).table(), {}, Soon()).ok()) << "resumed";
}

TEST(MakeCoreBackend, RefusesOptionsThatCannotBeAndASecondDaemon) {
  test::SimulatedDisk disk;
  CoreBackendOptions options;
  options.data_dir = "data";
  options.file_system = &disk;
  options.threads = 0;
  EXPECT_EQ(MakeCoreBackend(options).error().code, core::ErrorCode::kInvalidArgument);
  options.threads = 1;
  const auto first = MakeCoreBackend(options);
  ASSERT_TRUE(first.ok());
  const auto second = MakeCoreBackend(options);
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.error().code, core::ErrorCode::kInvalidArgument);
}

}  // namespace
}  // namespace kdray::server
