// SPDX-License-Identifier: Apache-2.0
#include "server/block_pool.h"

#include <sys/mman.h>

#include <algorithm>
#include <new>
#include <system_error>

namespace kdray::server {
namespace {

constexpr std::size_t kBytes = BlockPool::kBlockBytes;

/// Not from malloc(), which might keep freed blocks. Aligned to its size, so that huge pages fit.
char* Map() {
  const auto map = [](std::size_t bytes) {
    void* const memory =
        mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) throw std::bad_alloc();
    return static_cast<char*>(memory);
  };
  char* const wide = map(2 * kBytes);
  const std::size_t before = (kBytes - reinterpret_cast<std::uintptr_t>(wide) % kBytes) % kBytes;
  char* const block = wide + before;
  if (before != 0) munmap(wide, before);
  munmap(block + kBytes, kBytes - before);
  // Only advice: without free huge pages the system uses small ones.
  static_cast<void>(madvise(block, kBytes, MADV_HUGEPAGE));
  return block;
}

void Unmap(char* block) { munmap(block, kBytes); }

}  // namespace

BlockPool::BlockPool(std::uint64_t most_bytes, std::chrono::milliseconds idle_time)
    : most_bytes_(most_bytes), idle_time_(idle_time), limit_bytes_(most_bytes) {
  kept_.reserve(most_bytes / kBytes);
}

BlockPool::~BlockPool() {
  const std::lock_guard lock(mutex_);
  ReleaseLocked(0);
}

char* BlockPool::Take() {
  {
    const std::lock_guard lock(mutex_);
    last_use_ = std::chrono::steady_clock::now();
    if (!kept_.empty()) {
      char* const block = kept_.back();
      kept_.pop_back();
      kept_bytes_ -= kBytes;
      return block;
    }
    if (!releaser_.joinable() && kept_.capacity() != 0) {
      try {
        releaser_ = std::jthread([this](const std::stop_token& stop) { ReleaseWhenIdle(stop); });
      } catch (const std::system_error&) {
        // Until there is a thread for it, no block is kept (GiveBack).
      }
    }
  }
  return Map();
}

void BlockPool::GiveBack(char* block) noexcept {
  {
    const std::lock_guard lock(mutex_);
    last_use_ = std::chrono::steady_clock::now();
    if (releaser_.joinable() && kept_.size() < kept_.capacity() &&
        kept_bytes_ + kBytes <= limit_bytes_) {
      kept_.push_back(block);
      kept_bytes_ += kBytes;
      if (kept_.size() == 1) changed_.notify_one();
      return;
    }
  }
  Unmap(block);
}

void BlockPool::KeepAtMost(std::uint64_t bytes) {
  limit_bytes_ = std::min(bytes, most_bytes_);
  if (kept_bytes_ <= limit_bytes_) return;
  const std::lock_guard lock(mutex_);
  ReleaseLocked(static_cast<std::size_t>(limit_bytes_ / kBytes));
}

void BlockPool::ReleaseWhenIdle(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (changed_.wait(lock, stop, [this] { return !kept_.empty(); })) {
    const auto end = last_use_ + idle_time_;
    if (std::chrono::steady_clock::now() >= end) {
      ReleaseLocked(0);
    } else {
      changed_.wait_until(lock, stop, end, [] { return false; });
    }
  }
}

void BlockPool::ReleaseLocked(std::size_t blocks_left) {
  for (; kept_.size() > blocks_left; kept_.pop_back()) {
    Unmap(kept_.back());
    kept_bytes_ -= kBytes;
  }
}

}  // namespace kdray::server
