// SPDX-License-Identifier: Apache-2.0
// Trees with their binary trees, as cells need them: loaded, made and paid for.
#include <gtest/gtest.h>

#include <optional>

#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::ErrorCode;
using core::TreeId;

class LibraryBinaryTest : public LibraryTest {
 protected:
  static constexpr int kRings = 30;
  LibraryBinaryTest() { Open(); }
};

TEST_F(LibraryBinaryTest, AQueryNeedsNoBinaryTreeAndCellsMakeItOnce) {
  const TreeId id = Add(SphereBytes(1, kRings), BuildKind::kKdSah);
  Settle();  // the build's own memory is returned
  const auto plain = library_->Load(id, Soon());
  ASSERT_TRUE(plain.ok());
  EXPECT_EQ(plain->tree->kept_binary(), nullptr);
  const std::uint64_t used = library_->counters().memory_bytes;
  for (int i = 0; i < 2; ++i) {
    const auto scene = library_->LoadWithBinary(id, Soon());
    ASSERT_TRUE(scene.ok()) << scene.error().message;
    EXPECT_NE(scene->tree->kept_binary(), nullptr);
  }
  EXPECT_EQ(library_->counters().binary_rebuilds, 1u);
  EXPECT_EQ(library_->counters().memory_bytes, used) << "charged when the tree was loaded";
}

TEST_F(LibraryBinaryTest, CellsAreRefusedWhileOthersHoldTheMemory) {
  const TreeId id = Add(SphereBytes(1, kRings), BuildKind::kKdSah);
  const TreeId other = Add(SphereBytes(2, kRings), BuildKind::kKdSah);
  Settle();
  std::uint64_t own = 0;
  std::uint64_t estimate = 0;
  {
    const auto scene = library_->Load(id, Soon());
    ASSERT_TRUE(scene.ok());
    own = library_->counters().memory_bytes;
    estimate = core::EstimateBuildBytes(scene->mesh->triangle_count(), BuildKind::kKdSah);
  }
  options_.memory_limit_bytes = own + estimate + own / 2;
  Open();
  std::optional<core::Scene> held = *library_->Load(other, Soon());
  const auto refused = library_->LoadWithBinary(id, Soon());
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::kMemoryFull);
  EXPECT_FALSE(AnswersOf(library_.get(), id).empty()) << "queries need no more";
  held.reset();
  // The worker that loaded it may hold it a little longer.
  const core::CancelToken soon = Soon();
  auto answered = library_->LoadWithBinary(id, soon);
  while (!answered.ok() && !soon.ShouldStop()) answered = library_->LoadWithBinary(id, soon);
  EXPECT_TRUE(answered.ok());
}

TEST_F(LibraryBinaryTest, AfterAShutdownNoneIsMade) {
  const TreeId id = Add(SphereBytes(1), BuildKind::kBvh);
  ASSERT_TRUE(library_->Load(id, Soon()).ok());
  library_->Shutdown();
  EXPECT_EQ(library_->LoadWithBinary(id, Soon()).error().code, ErrorCode::kCancelled);
}

TEST_F(LibraryBinaryTest, ADeletedTreeTakesItsBinaryTreeAlong) {
  const TreeId id = Add(SphereBytes(1, kRings), BuildKind::kKdSah);
  ASSERT_TRUE(library_->LoadWithBinary(id, Soon()).ok());
  ASSERT_TRUE(library_->Delete(id).ok());
  Settle();
  EXPECT_EQ(library_->counters().memory_bytes, 0u);
}

}  // namespace
}  // namespace kdray::test
