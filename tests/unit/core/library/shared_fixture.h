// SPDX-License-Identifier: Apache-2.0
// Two libraries, each with a disk of its own, on one object store.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <memory>
#include <optional>
#include <vector>

#include "core/library/tree_library.h"
#include "tests/support/memory_object_store.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/wait_until.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {

class SharedLibraryTest : public testing::Test {
 protected:
  static constexpr std::size_t kLibraries = 2;

  SharedLibraryTest() {
    for (core::LibraryOptions& options : options_) {
      options.data_dir = "data";
      options.memory_limit_bytes = std::uint64_t{1} << 30;
      options.retry_after = std::chrono::milliseconds(0);
      options.shared.store = &objects_;
      options.shared.name = "s3://bucket/prefix";
      // Every question is asked, and nothing waits.
      options.shared.confirm_every = std::chrono::milliseconds(0);
      options.shared.retries = {.attempts = 3,
                                .first_backoff = std::chrono::milliseconds(0),
                                .most_backoff = std::chrono::milliseconds(0),
                                .first_pause = std::chrono::milliseconds(0),
                                .most_pause = std::chrono::milliseconds(0)};
    }
    for (std::size_t i = 0; i < kLibraries; ++i) options_[i].file_system = &disks_[i];
  }
  void Open(std::size_t i) {
    libraries_[i].reset();
    auto library = core::TreeLibrary::Open(options_[i]);
    ASSERT_TRUE(library.ok()) << library.error().message;
    libraries_[i] = *std::move(library);
  }
  void OpenBoth() {
    for (std::size_t i = 0; i < kLibraries; ++i) Open(i);
  }
  core::TreeLibrary& library(std::size_t i) { return *libraries_[i]; }
  /// Uploads, and waits until it is built.
  core::TreeId Add(std::size_t i, const std::vector<std::byte>& bytes,
                   std::optional<core::BuildKind> build = std::nullopt) {
    const auto added = Upload(&library(i), bytes, build);
    EXPECT_TRUE(added.ok()) << added.error().message;
    if (!added.ok()) return {};
    EXPECT_TRUE(library(i).Load(added->id, Soon()).ok());
    return added->id;
  }
  /// Waits until a library has put its tree into the store.
  void WaitForTree() {
    EXPECT_TRUE(WaitUntil([this] { return !objects_.Keys("trees/").empty(); }));
  }
  std::optional<core::ErrorCode> CodeOfLoad(std::size_t i, const core::TreeId& id) {
    const auto scene = library(i).Load(id, Soon());
    if (scene.ok()) return std::nullopt;
    return scene.error().code;
  }

  MemoryObjectStore objects_;
  std::array<SimulatedDisk, kLibraries> disks_;
  std::array<core::LibraryOptions, kLibraries> options_;
  std::array<std::unique_ptr<core::TreeLibrary>, kLibraries> libraries_;
};

}  // namespace kdray::test
