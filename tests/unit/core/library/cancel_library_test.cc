// SPDX-License-Identifier: Apache-2.0
// A deletion and a shutdown end the reading and writing of stored files, and nothing that was cut
// off is taken for damaged.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/cancel_probe.h"
#include "tests/support/watched_disk.h"
#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::BuildKind;
using core::ErrorCode;
using core::TreeId;

constexpr std::size_t kMiB = std::size_t{1} << 20;

// A library whose disk a test can look at while it works.
class CancelledLibraryTest : public LibraryTest {
 protected:
  CancelledLibraryTest() {
    options_.file_system = &watched_;
    Open();
  }

  /// A mesh whose files have some MiB. All are written when it returns.
  TreeId AddLarge() {
    const TreeId id = Add(bytes_, BuildKind::kBvh);
    // Work on one mesh runs in order: this is begun when the files of the other are written.
    EXPECT_TRUE(library_->Delete(Add(bytes_, BuildKind::kBox)).ok());
    return id;
  }

  const std::vector<std::byte> bytes_ = SphereBytes(1, 160);
  WatchedDisk watched_{&disk_};
};

// Smaller pieces are of small files, or of an upload.
bool IsLarge(std::size_t piece) { return piece > kMiB / 2; }

TEST_F(CancelledLibraryTest, AMeshThatIsNotReadToItsEndIsNotTakenForDamaged) {
  const TreeId id = AddLarge();
  const auto file = library_->OpenMesh(id, CancelledAtLook(2));
  ASSERT_FALSE(file.ok());
  EXPECT_EQ(file.error().code, ErrorCode::kCancelled);
  EXPECT_EQ(library_->counters().unreadable_meshes, 0U);
  EXPECT_EQ(library_->counters().damaged_files, 0U);
  EXPECT_TRUE(library_->OpenMesh(id).ok());
}

TEST_F(CancelledLibraryTest, ADeletionEndsTheReadingOfItsTree) {
  const TreeId id = AddLarge();
  std::atomic<core::TreeLibrary*> library = nullptr;
  std::atomic<bool> is_deleted{false};
  std::atomic<std::size_t> bytes_after{0};
  watched_.on_read = [&](std::size_t bytes) {
    if (library == nullptr || !IsLarge(bytes)) return;
    if (is_deleted.exchange(true)) {
      bytes_after += bytes;
    } else {
      EXPECT_TRUE(library.load()->Delete(id).ok());
    }
  };
  Open();
  library = library_.get();
  EXPECT_EQ(library_->Load(id, Soon()).error().code, ErrorCode::kNotFound);
  library_->Shutdown();
  EXPECT_TRUE(is_deleted);
  EXPECT_LE(bytes_after, 2 * kMiB);
  EXPECT_EQ(library_->counters().damaged_files, 0U);
  EXPECT_EQ(library_->counters().parses, 0U) << "made anew from the mesh instead";
  EXPECT_EQ(library_->counters().builds, 0U);
}

TEST_F(CancelledLibraryTest, AShutdownEndsTheWritingOfALargeFileAndTheNextStartMakesItAgain) {
  std::atomic<core::TreeLibrary*> library = library_.get();
  std::atomic<std::size_t> pieces{0};
  std::atomic<bool> has_begun{false};
  std::thread shutdown;
  watched_.on_write = [&](std::size_t bytes) {
    if (library == nullptr || bytes < kMiB || pieces++ != 0) return;
    const TreeId id = library.load()->List(std::nullopt, std::nullopt, 1).at(0).record.id;
    shutdown = std::thread([&] { library.load()->Shutdown(); });
    while (library.load()->Measure(id, {}).ok()) std::this_thread::yield();
    // A slow disk: the time that a shutdown leaves to small files passes.
    std::this_thread::sleep_for(std::chrono::milliseconds(110));
    has_begun = true;
  };
  auto upload = library_->BeginUpload(bytes_.size());
  constexpr std::size_t kPiece = kMiB / 4;
  for (std::size_t at = 0; at < bytes_.size(); at += kPiece) {
    const std::size_t size = std::min(kPiece, bytes_.size() - at);
    ASSERT_TRUE(upload->Append(std::span(bytes_).subspan(at, size)).ok());
  }
  const auto added = library_->Finish(*std::move(upload), BuildKind::kBvh);
  ASSERT_TRUE(added.ok());
  const auto answers = AnswersOf(library_.get(), added->id);
  while (!has_begun) std::this_thread::yield();
  shutdown.join();
  EXPECT_LE(pieces, 2U) << "pieces of a MiB, one of each file";
  EXPECT_EQ(FilesIn("trees"), 0U);
  library = nullptr;
  Open();
  EXPECT_EQ(AnswersOf(library_.get(), added->id), answers);
  library_.reset();  // before what on_write refers to
}

}  // namespace
}  // namespace kdray::test
