// SPDX-License-Identifier: Apache-2.0
// Each allocation of each operation fails once, in whichever thread makes it. The operation may
// then fail as well. But no thread hangs, nothing ends the process, and every later query gets its
// right answer. A program of its own, since it replaces operator new.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "core/library/memory_budget.h"
#include "core/library/tree_cache.h"
#include "core/library/tree_library.h"
#include "core/store/disk_usage.h"
#include "tests/support/mesh_files.h"
#include "tests/support/temporary_folder.h"

namespace {

std::atomic<long> allocations_left{-1};  // until one fails; below 0: none does
thread_local bool spared = false;        // this thread's allocations always succeed

void* Allocate(std::size_t size, std::size_t alignment) {
  if (!spared && allocations_left.load(std::memory_order_relaxed) >= 0 &&
      allocations_left.fetch_sub(1) == 0) {
    throw std::bad_alloc();
  }
  void* block = alignment <= alignof(std::max_align_t)
                    ? std::malloc(size == 0 ? 1 : size)
                    : std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
  if (block == nullptr) throw std::bad_alloc();
  return block;
}

}  // namespace

// The other forms of operator new and delete call these.
void* operator new(std::size_t size) { return Allocate(size, 0); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return Allocate(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* block) noexcept { std::free(block); }
void operator delete(void* block, std::size_t) noexcept { std::free(block); }
void operator delete(void* block, std::align_val_t) noexcept { std::free(block); }
void operator delete(void* block, std::size_t, std::align_val_t) noexcept { std::free(block); }

namespace kdray::core {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

/// Runs `work` with allocation number `n` failing. False when it never came to that allocation.
bool RunWithFailure(long n, const std::function<void()>& work) {
  allocations_left = n;
  try {
    work();
  } catch (const std::bad_alloc&) {
  }
  return allocations_left.exchange(-1) < 0;
}

std::vector<std::byte> Tetrahedron(int number) {
  return test::Bytes("OFF\n4 4 0\n0 0 " + std::to_string(-number) +
                     "\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n");
}
constexpr const char* kBroken = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n";

// fsync costs nothing in memory.
std::filesystem::path Scratch(const test::TemporaryFolder& folder) {
  const std::filesystem::path memory = "/dev/shm";
  std::error_code error;
  if (!std::filesystem::is_directory(memory, error)) return folder.path();
  return memory / folder.path().filename();
}

class LibraryAllocationTest : public testing::Test {
 protected:
  LibraryAllocationTest() : scratch_(Scratch(folder_)) {
    options_.data_dir = scratch_ / "data";
    options_.build_threads = 1;
    options_.retry_after = milliseconds(0);
    options_.memory_limit_bytes = std::uint64_t{1} << 28;
  }
  ~LibraryAllocationTest() override {
    library_.reset();
    std::error_code error;
    std::filesystem::remove_all(scratch_, error);
  }

  Result<TreeLibrary::Added> Upload(const std::vector<std::byte>& bytes) {
    auto upload = library_->BeginUpload(bytes.size());
    if (!upload.ok()) return std::move(upload).error();
    if (Status status = upload->Append(bytes); !status.ok()) return std::move(status).error();
    return library_->Finish(*std::move(upload), std::nullopt);
  }
  void Open() {
    library_.reset();
    auto library = TreeLibrary::Open(options_);
    ASSERT_TRUE(library.ok()) << library.error().message;
    library_ = *std::move(library);
  }
  CancelToken Soon() {
    return CancelToken::WithDeadline(steady_clock::now() + std::chrono::seconds(20));
  }
  bool IsBuilt(const TreeId& id) {
    const auto info = library_->Wait(id, steady_clock::now() + std::chrono::seconds(20), {});
    return info.ok() && info->ready();
  }
  void WaitUntilIdle(const TreeId& id) {
    try {
      (void)library_->Wait(id, steady_clock::now() + std::chrono::seconds(20), {});
    } catch (const std::bad_alloc&) {
    }
  }
  /// The names of files of a mesh in the data directory.
  std::vector<std::string> FilesOf(const Sha256Digest& mesh) const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(options_.data_dir)) {
      const std::string name = entry.path().filename();
      if (name.starts_with(mesh.ToHex())) names.push_back(entry.path());
    }
    return names;
  }
  /// A worker may still write a file of a tree that was removed; it removes it itself. A tree whose
  /// build has just failed for lack of memory is not gone, though Find() may give that error.
  void ExpectNoFilesIfGone(const TreeId& id) {
    spared = true;
    if (library_->List(id.mesh, std::nullopt, 1).empty()) {
      const auto end = steady_clock::now() + std::chrono::seconds(5);
      std::vector<std::string> names;
      while (!(names = FilesOf(id.mesh)).empty() && steady_clock::now() < end) {
        std::this_thread::sleep_for(milliseconds(1));
      }
      EXPECT_EQ(names, std::vector<std::string>());
    }
    spared = false;
  }
  static TradeoffOptions Quick() {
    TradeoffOptions options;
    options.rays = 8;
    options.runs = 1;
    options.trace_time = milliseconds(0);
    return options;
  }

  /// All that can be asked, of a library in which `first_` should be: it answers, whatever failed.
  void ExpectSound(const std::string& what) {
    const TreeId second{HashBytes(Tetrahedron(2)), std::nullopt};
    for (const int number : {1, 2}) {
      const auto again = Upload(Tetrahedron(number));
      ASSERT_TRUE(again.ok()) << what << ": " << again.error().message;
      ASSERT_TRUE(IsBuilt(again->id)) << what << ": mesh " << number;
      ASSERT_TRUE(library_->Find(again->id).ok()) << what;
      ASSERT_TRUE(library_->LoadWithBinary(again->id, Soon()).ok()) << what;
      ASSERT_TRUE(library_->OpenMesh(again->id).ok()) << what;
    }
    const auto list = library_->List(std::nullopt, std::nullopt, 100);
    ASSERT_EQ(list.size(), library_->counters().trees) << what;
    for (const TreeInfo& listed : list) {
      const auto info =
          library_->Wait(listed.record.id, steady_clock::now() + std::chrono::seconds(20), {});
      ASSERT_TRUE(info.ok() ? info->ready() : info.error().code == ErrorCode::kInvalidMesh) << what;
    }
    const auto measured =
        library_->WaitForMeasured(second, steady_clock::now() + std::chrono::seconds(20), Soon());
    ASSERT_TRUE(!measured.ok() || !measured->has_value() || (*measured)->measured) << what;
    // What was answered is there after a restart, and what goes gives its memory back.
    Open();
    for (const int number : {1, 2}) {
      const TreeId id{HashBytes(Tetrahedron(number)), std::nullopt};
      ASSERT_TRUE(library_->Find(id).ok()) << what;
      ASSERT_TRUE(library_->OpenMesh(id).ok()) << what;
    }
    for (const TreeInfo& info : library_->List(std::nullopt, std::nullopt, 100)) {
      const Status deleted = library_->Delete(info.record.id);
      ASSERT_TRUE(deleted.ok() || deleted.error().code == ErrorCode::kNotFound) << what;
    }
    library_->Shutdown();
    ASSERT_EQ(library_->counters().memory_bytes, 0u) << what;
    ASSERT_EQ(library_->counters().trees, 0u) << what;
  }

  /// `prepare` on a library with one tree, then `work` with each allocation failing once, in this
  /// thread and the workers', then everything is asked again.
  void Sweep(const std::string& what, const std::function<void()>& prepare,
             const std::function<void()>& work) {
    long n = 0;
    // Beyond the first ones, long work repeats itself.
    for (bool failed = true; failed && !HasFatalFailure(); n += n < 200 ? 1 : n / 8) {
      library_.reset();
      std::filesystem::remove_all(scratch_);
      std::filesystem::create_directories(scratch_);
      Open();
      first_ = Upload(Tetrahedron(1))->id;
      ASSERT_TRUE(IsBuilt(first_));
      prepare();
      failed = RunWithFailure(n, work);
      ExpectSound(what + ", allocation " + std::to_string(n));
    }
    EXPECT_GT(n, 1) << what << " allocates nothing";
    RecordProperty(what, static_cast<int>(n));
  }

  test::TemporaryFolder folder_;
  std::filesystem::path scratch_;
  LibraryOptions options_;
  std::unique_ptr<TreeLibrary> library_;
  TreeId first_;
};

TEST_F(LibraryAllocationTest, AnUploadAndItsBuild) {
  const auto bytes = Tetrahedron(2);
  const TreeId id{HashBytes(bytes), std::nullopt};
  Sweep(
      "upload", [] {},
      [&] {
        (void)Upload(bytes);
        WaitUntilIdle(id);
      });
}

TEST_F(LibraryAllocationTest, AnUploadWhoseWorkersAloneFail) {
  const auto bytes = Tetrahedron(2);
  Sweep(
      "build", [] {},
      [&] {
        spared = true;
        const auto added = Upload(bytes);
        (void)library_->Wait(added->id, steady_clock::now() + std::chrono::seconds(20), {});
        spared = false;
      });
}

TEST_F(LibraryAllocationTest, ABrokenUpload) {
  const auto bytes = test::Bytes(kBroken);
  const TreeId id{HashBytes(bytes), std::nullopt};
  Sweep(
      "broken upload", [] {},
      [&] {
        (void)Upload(bytes);
        WaitUntilIdle(id);
      });
}

TEST_F(LibraryAllocationTest, AnotherBuild) {
  const TreeId id{HashBytes(Tetrahedron(1)), BuildKind::kBvh};
  Sweep(
      "add build", [] {},
      [&] {
        (void)library_->AddBuild(first_.mesh, BuildKind::kBvh);
        WaitUntilIdle(id);
      });
}

TEST_F(LibraryAllocationTest, LoadingFromDisk) {
  Sweep(
      "load", [&] { Open(); }, [&] { (void)library_->Load(first_, Soon()); });
}

TEST_F(LibraryAllocationTest, MakingABinaryTree) {
  Sweep(
      "binary", [] {}, [&] { (void)library_->LoadWithBinary(first_, Soon()); });
}

TEST_F(LibraryAllocationTest, Questions) {
  Sweep(
      "questions", [] {},
      [&] {
        (void)library_->Find(first_);
        (void)library_->List(std::nullopt, std::nullopt, 10);
        (void)library_->OpenMesh(first_);
        (void)library_->Find({first_.mesh, BuildKind::kBox});
        (void)library_->WaitForMeasured(first_, steady_clock::now(), {});
      });
}

TEST_F(LibraryAllocationTest, ADeletion) {
  Sweep(
      "delete", [] {}, [&] { (void)library_->Delete(first_); });
}

TEST_F(LibraryAllocationTest, ADeletionLeavesNoFiles) {
  Sweep(
      "delete and look", [] {},
      [&] {
        try {
          (void)library_->Delete(first_);
        } catch (const std::bad_alloc&) {
        }
        ExpectNoFilesIfGone(first_);
      });
}

TEST_F(LibraryAllocationTest, AnUploadThatFailsLeavesNoFiles) {
  const auto bytes = Tetrahedron(2);
  const TreeId id{HashBytes(bytes), std::nullopt};
  Sweep(
      "upload and look", [] {},
      [&] {
        try {
          (void)Upload(bytes);
        } catch (const std::bad_alloc&) {
        }
        ExpectNoFilesIfGone(id);
        WaitUntilIdle(id);
      });
}

TEST_F(LibraryAllocationTest, Measuring) {
  Sweep(
      "measure", [] {},
      [&] {
        (void)library_->Measure(first_, Quick());
        (void)library_->WaitForMeasured(first_, steady_clock::now() + std::chrono::seconds(20), {});
      });
}

TEST_F(LibraryAllocationTest, ForgettingAMeasurement) {
  Sweep(
      "forget",
      [&] {
        (void)library_->Measure(first_, Quick());
        (void)library_->WaitForMeasured(first_, steady_clock::now() + std::chrono::seconds(20), {});
      },
      [&] { (void)library_->ForgetMeasured(first_); });
}

TEST_F(LibraryAllocationTest, ShuttingDown) {
  Sweep(
      "shutdown", [&] { (void)library_->AddBuild(first_.mesh, BuildKind::kKdSah); },
      [&] {
        const auto unneeded = std::make_unique<int>(0);  // one allocation at least
        library_->Shutdown();
        spared = true;
        Open();
        spared = false;
      });
}

TEST_F(LibraryAllocationTest, Opening) {
  Sweep(
      "open", [&] { library_.reset(); },
      [&] {
        try {
          auto library = TreeLibrary::Open(options_);
          if (library.ok()) library_ = *std::move(library);
        } catch (...) {
        }
        if (library_ == nullptr) {
          spared = true;
          Open();
          spared = false;
        }
      });
}

}  // namespace
}  // namespace kdray::core
