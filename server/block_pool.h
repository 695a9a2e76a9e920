// SPDX-License-Identifier: Apache-2.0
// Large blocks of memory for batches. Those that come back are kept for a while.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

#include "api/byte_block.h"

namespace kdray::server {

/// The system sets a page to zero when it is first touched, which takes longer than to receive its
/// bytes. So blocks that come back are kept for the next batch, up to a limit, until no block has
/// been taken or has come back for some time. Blocks lie on huge pages if the system has some. Safe
/// from many threads at once.
class BlockPool final : public api::BlockSource {
 public:
  static constexpr std::size_t kBlockBytes = std::size_t{4} << 20;
  static constexpr std::chrono::milliseconds kIdleTime{5000};

  /// Keeps at most `most_bytes`.
  explicit BlockPool(std::uint64_t most_bytes, std::chrono::milliseconds idle_time = kIdleTime);
  /// Every block must have come back.
  ~BlockPool() override;
  BlockPool(const BlockPool&) = delete;
  BlockPool& operator=(const BlockPool&) = delete;

  std::size_t block_bytes() const override { return kBlockBytes; }
  char* Take() override;
  void GiveBack(char* block) noexcept override;

  /// From now on at most `bytes` are kept, and at most what the constructor says.
  void KeepAtMost(std::uint64_t bytes);
  /// Bytes of the idle blocks.
  std::uint64_t kept_bytes() const { return kept_bytes_; }

 private:
  void ReleaseWhenIdle(const std::stop_token& stop);
  void ReleaseLocked(std::size_t blocks_left);

  const std::uint64_t most_bytes_;
  const std::chrono::milliseconds idle_time_;
  std::atomic<std::uint64_t> limit_bytes_, kept_bytes_{0};
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::vector<char*> kept_;  ///< the last one came back last; it never grows beyond its capacity
  std::chrono::steady_clock::time_point last_use_;
  std::jthread releaser_;  ///< made with the first block
};

}  // namespace kdray::server
