// SPDX-License-Identifier: Apache-2.0
// What a library measures on its meshes, and how long it keeps it.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <thread>
#include <vector>

#include "tests/support/wait_until.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::core {
namespace {

using test::Soon;
using test::SphereBytes;

std::chrono::steady_clock::time_point Later() {
  return std::chrono::steady_clock::now() + std::chrono::minutes(2);
}

TradeoffOptions Quick() {
  TradeoffOptions options;
  options.rays = 256;
  options.runs = 1;
  options.trace_time = std::chrono::milliseconds(50);
  return options;
}

class LibraryMeasureTest : public test::LibraryTest {
 protected:
  LibraryMeasureTest() { Open(); }

  std::optional<MeasuredTradeoff> Measured(const TreeId& id) {
    const auto info = library_->WaitForMeasured(id, Later(), Soon());
    EXPECT_TRUE(info.ok()) << info.error().message;
    if (!info.ok() || !*info) return std::nullopt;
    return (*info)->measured;
  }
  std::optional<MeasuredTradeoff> Measure(const TreeId& id) {
    EXPECT_TRUE(library_->Measure(id, Quick()).ok());
    return Measured(id);
  }
  /// Begins one that ends when it is cancelled, and waits until it runs.
  void MeasureForEver(const TreeId& id) {
    TradeoffOptions options = Quick();
    options.trace_time = std::chrono::hours(1);
    const auto running = std::make_shared<std::atomic<bool>>(false);
    options.is_disturbed = [running] { return *running = true; };
    ASSERT_TRUE(library_->Measure(id, options).ok());
    ASSERT_TRUE(test::WaitUntil([&] { return running->load(); }, std::chrono::minutes(2)));
  }
};

TEST_F(LibraryMeasureTest, NothingIsThereUntilItIsAskedFor) {
  const TreeId id = Add(SphereBytes(1));
  EXPECT_EQ(Measured(id), std::nullopt);
  const std::optional<MeasuredTradeoff> measured = Measure(id);
  ASSERT_TRUE(measured);
  EXPECT_TRUE(measured->tradeoff.closed);
  EXPECT_TRUE(measured->tradeoff.from_inside);
  EXPECT_EQ(measured->tradeoff.pairs.size(), 24u);
  EXPECT_GT(measured->measured_ms, 0);
  EXPECT_EQ(Measured(id), measured);
}

TEST_F(LibraryMeasureTest, WhatWasMeasuredBelongsToTheMeshAndSurvivesARestart) {
  const TreeId id = Add(SphereBytes(1));
  const std::optional<MeasuredTradeoff> measured = Measure(id);
  const TreeId other = Add(SphereBytes(1), BuildKind::kBvh);
  EXPECT_EQ(Measured(other), measured);
  Open();
  EXPECT_EQ(Measured(id), measured);
  EXPECT_EQ(FilesIn("measured"), 1u);
  EXPECT_EQ(library_->counters().damaged_files, 0u);

  ASSERT_TRUE(library_->Delete(id).ok());
  EXPECT_EQ(Measured(other), measured);
  ASSERT_TRUE(library_->Delete(other).ok());
  EXPECT_EQ(FilesIn("measured"), 0u);
}

TEST_F(LibraryMeasureTest, AForgottenMeasurementIsGoneForGood) {
  const TreeId id = Add(SphereBytes(1));
  Measure(id);
  EXPECT_TRUE(*library_->ForgetMeasured(id));
  EXPECT_FALSE(*library_->ForgetMeasured(id));
  EXPECT_EQ(Measured(id), std::nullopt);
  Open();
  EXPECT_EQ(Measured(id), std::nullopt);
  EXPECT_EQ(FilesIn("measured"), 0u);
}

TEST_F(LibraryMeasureTest, ForgettingStopsWhatIsUnderWay) {
  const TreeId id = Add(SphereBytes(1));
  MeasureForEver(id);
  const auto info = library_->WaitForMeasured(id, std::chrono::steady_clock::now(), Soon());
  ASSERT_TRUE(info.ok() && info->has_value());
  EXPECT_FALSE((*info)->measured);
  EXPECT_GT((*info)->progress, 0);
  EXPECT_LT((*info)->progress, 1);
  EXPECT_TRUE(*library_->ForgetMeasured(id));
  EXPECT_EQ(Measured(id), std::nullopt);
  EXPECT_TRUE(Measure(id)) << "the next one has its turn";
}

TEST_F(LibraryMeasureTest, DeletingTheMeshStopsItToo) {
  const TreeId id = Add(SphereBytes(1));
  MeasureForEver(id);
  ASSERT_TRUE(library_->Delete(id).ok());
  EXPECT_EQ(library_->WaitForMeasured(id, Later(), Soon()).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(library_->Measure(id, Quick()).error().code, ErrorCode::kNotFound);
  EXPECT_TRUE(Measure(Add(SphereBytes(2))));
}

TEST_F(LibraryMeasureTest, TreesAreLoadedAndBuiltMeanwhile) {
  const TreeId id = Add(SphereBytes(1));
  MeasureForEver(id);
  EXPECT_FALSE(test::AnswersOf(library_.get(), Add(SphereBytes(1), BuildKind::kBvh)).empty());
  EXPECT_FALSE(test::AnswersOf(library_.get(), Add(SphereBytes(2))).empty());
  EXPECT_TRUE(*library_->ForgetMeasured(id));
}

TEST_F(LibraryMeasureTest, WithoutMemoryItFailsAndTheLibraryGoesOn) {
  const TreeId id = Add(SphereBytes(1));
  TradeoffOptions options = Quick();
  options.rays = std::size_t{1} << 40;
  ASSERT_TRUE(library_->Measure(id, options).ok());
  const auto info = library_->WaitForMeasured(id, Later(), Soon());
  ASSERT_FALSE(info.ok());
  EXPECT_EQ(info.error().code, ErrorCode::kMemoryFull);
  EXPECT_TRUE(Measure(id));
}

TEST_F(LibraryMeasureTest, ADamagedFileIsNothingMeasured) {
  const TreeId id = Add(SphereBytes(1));
  Measure(id);
  library_.reset();
  const std::filesystem::path file = std::filesystem::path("data/measured") / id.mesh.ToHex();
  std::vector<std::byte> contents = *disk_.Contents(file);
  contents[contents.size() / 2] ^= std::byte{1};
  disk_.SetContents(file, std::move(contents));
  Open();
  EXPECT_EQ(Measured(id), std::nullopt);
  EXPECT_GE(library_->counters().damaged_files, 1u);
  EXPECT_TRUE(Measure(id));
}

TEST_F(LibraryMeasureTest, WhoWaitsForAMeasuringHoldsUpNothingElse) {
  const TreeId id = Add(SphereBytes(1));
  // Whoever waits looks for a stored measurement first; a measuring that begins in between is
  // waited for like any other. So both go on until such a meeting has happened many times.
  std::atomic<bool> ends{false};
  std::vector<std::thread> clients;
  for (int i = 0; i < 2; ++i) {
    clients.emplace_back([&] {
      while (!ends) {
        (void)library_->WaitForMeasured(
            id, std::chrono::steady_clock::now() + std::chrono::seconds(2), Soon());
      }
    });
  }
  TradeoffOptions options = Quick();
  options.trace_time = std::chrono::hours(1);
  std::chrono::steady_clock::duration longest{};
  const auto begin = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() - begin < std::chrono::milliseconds(1500)) {
    EXPECT_TRUE(library_->ForgetMeasured(id).ok());
    EXPECT_TRUE(library_->Measure(id, options).ok());
    const auto start = std::chrono::steady_clock::now();
    EXPECT_TRUE(library_->AddBuild(id.mesh, std::nullopt).ok());
    longest = std::max(longest, std::chrono::steady_clock::now() - start);
  }
  ends = true;
  EXPECT_TRUE(library_->ForgetMeasured(id).ok());
  for (std::thread& client : clients) client.join();
  EXPECT_LT(longest, std::chrono::milliseconds(1500));
}

TEST_F(LibraryMeasureTest, AMeasuringThatWaitsForItsTreeLeavesItsPlaceToBuilds) {
  std::vector<TreeId> ids;
  for (int number = 1; number <= 3; ++number) ids.push_back(Add(SphereBytes(number, 30)));
  Open();
  // Each is read in again while the measurings before it run.
  for (const TreeId& id : ids) EXPECT_TRUE(library_->Measure(id, Quick()).ok());
  for (const TreeId& id : ids) EXPECT_TRUE(Measured(id));
}

TEST_F(LibraryMeasureTest, AShutdownDoesNotWaitForIt) {
  MeasureForEver(Add(SphereBytes(1)));
  const auto start = std::chrono::steady_clock::now();
  library_->Shutdown();
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(30));
}

}  // namespace
}  // namespace kdray::core
