// SPDX-License-Identifier: Apache-2.0
// The memory of all running requests: bodies, the data made from them, pictures, and answers until
// they are sent. It is a part of --memory-limit. Beyond it, requests fail within milliseconds.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "api/byte_block.h"
#include "api/types.h"
#include "core/library/memory_budget.h"
#include "server/block_pool.h"
#include "server/growing_bytes.h"

namespace kdray::server {

/// Memory is charged when it is needed: for work when it begins, for a body as its bytes arrive. A
/// declared length charges nothing, so it can only make its own request fail.
///
/// Requests own some bytes, and may borrow as many again from the memory of trees, which evicts
/// idle ones. Bodies do not borrow: a body waits for its tree, and may not hold what the tree
/// needs. Large requests leave an eighth of the own bytes to small ones, and large bodies a quarter
/// to work, so slow clients with large answers stop neither small requests nor large ones that have
/// been received.
///
/// What can never fit gets a code of status 413, what does not fit now memory_full. Before that, a
/// call waits some milliseconds for memory that an answer which was just sent is about to return.
///
/// Bodies are ordered by their start. When a body meets a full budget, newer bodies are dropped for
/// it, the newest first, if they hold enough; otherwise it fails itself. A dropped body frees its
/// bytes at once, and its request fails at its next piece.
///
/// Large blocks come from a pool (block_pool.h), which keeps some idle ones. Idle blocks are in no
/// share. They go back to the system when requests need their memory.
///
/// Safe from many threads at once.
class RequestMemory {
 public:
  struct Times {
    /// How long a call waits for memory that is about to be returned: a client that has its answer
    /// may ask again before.
    std::chrono::milliseconds settle{20};
    std::chrono::milliseconds pool_idle = BlockPool::kIdleTime;
  };
  /// `lender`, which must outlive this object, is the budget of trees; null: nothing is borrowed.
  explicit RequestMemory(std::uint64_t own_bytes, core::MemoryBudget* lender = nullptr)
      : RequestMemory(own_bytes, lender, Times()) {}
  RequestMemory(std::uint64_t own_bytes, core::MemoryBudget* lender, Times times)
      : own_(own_bytes),
        lender_(lender),
        settle_time_(times.settle),
        pool_(std::min(own_bytes / 8, kMostKeptBytes), times.pool_idle) {}

  /// A part of the budget, returned when destroyed.
  class Share {
   public:
    Share() = default;
    Share(Share&& other) noexcept
        : memory_(std::exchange(other.memory_, nullptr)),
          bytes_(std::exchange(other.bytes_, 0)),
          lender_bytes_(other.lender_bytes_) {}
    Share& operator=(Share&& other) noexcept {
      std::swap(memory_, other.memory_);
      std::swap(bytes_, other.bytes_);
      std::swap(lender_bytes_, other.lender_bytes_);
      return *this;
    }
    std::uint64_t bytes() const { return bytes_; }
    /// Returns what is above `bytes`.
    void ShrinkTo(std::uint64_t bytes) {
      if (bytes < bytes_) memory_->Return(std::exchange(bytes_, bytes) - bytes);
    }
    /// The request keeps `bytes` of the lender, its tree, until it ends: it can never borrow them.
    void KeepsOfLender(std::uint64_t bytes) { lender_bytes_ = bytes; }
    /// Adds `bytes`, or fails without a change: with `never` if they exceed what this request may
    /// ever hold, with memory_full if they are not free now.
    api::Check Grow(std::uint64_t bytes, api::ErrorCode never);
    ~Share() {
      if (memory_ != nullptr) memory_->Return(bytes_);
    }

   private:
    friend class RequestMemory;
    Share(RequestMemory* memory, std::uint64_t bytes, std::uint64_t lender_bytes = 0)
        : memory_(memory), bytes_(bytes), lender_bytes_(lender_bytes) {}
    RequestMemory* memory_ = nullptr;
    std::uint64_t bytes_ = 0;
    std::uint64_t lender_bytes_ = 0;
  };

  /// A share of `bytes` for a request that keeps `lender_bytes` of the lender; the problems of
  /// Share::Grow().
  api::Outcome<Share> Take(std::uint64_t bytes, api::ErrorCode never,
                           std::uint64_t lender_bytes = 0);
  /// The problem of a body of `bytes` that began now: body_too_large or memory_full. Charges
  /// nothing.
  api::Check CheckBody(std::uint64_t bytes) const;

  /// A body that is being received. For one thread at a time.
  class Body {
   public:
    explicit Body(RequestMemory* memory);
    Body(const Body&) = delete;
    Body& operator=(const Body&) = delete;
    ~Body();

    /// memory_full if this body was dropped, which it then stays; body_too_large.
    api::Check Append(std::span<const std::byte> piece);

    // A body may be decoded while it arrives: into blocks, in place of its text.

    /// look(text so far), unless this body was dropped: then memory_full.
    template <class Look>
    api::Check LookAtText(const Look& look) {
      return Use([&](const Parts* parts) { look(parts->text.view()); });
    }
    /// Takes away the text, which stays charged until ReturnText(). memory_full if this body was
    /// dropped.
    api::Outcome<GrowingBytes> TakeText();
    /// The text that was taken is freed.
    void ReturnText(std::uint64_t bytes);
    /// Adds an empty block. memory_full if this body was dropped or there is no room for a block.
    api::Check AddBlock();
    /// write(block) with the last block, unless this body was dropped: then memory_full.
    template <class Write>
    api::Check WriteToBlock(const Write& write) {
      return Use([&](Parts* parts) { write(&parts->blocks.back()); });
    }

    struct Whole {
      GrowingBytes text;
      Share share;  ///< of the bytes of text and blocks
      std::vector<api::ByteBlock> blocks;
    };
    /// The body is complete and cannot be dropped any more. memory_full if it was dropped before.
    /// Call once.
    api::Outcome<Whole> Finish();

   private:
    friend class RequestMemory;
    struct Parts {
      GrowingBytes text;
      std::vector<api::ByteBlock> blocks;
    };
    // `parts_mutex` is taken after the budget's mutex or alone.
    struct Held {
      // Guarded by the budget's mutex.
      std::uint64_t charged = 0;
      std::list<std::shared_ptr<Held>>::iterator place;

      std::mutex parts_mutex;
      Parts parts;
      bool refused = false;  // written with both mutexes held
    };

    /// use(parts), unless this body was dropped: then memory_full for `bytes` more.
    template <class F>
    api::Check Use(const F& use, std::uint64_t bytes = 0) {
      {
        const std::lock_guard parts_lock(held_->parts_mutex);
        if (!held_->refused) {
          use(&held_->parts);
          return std::nullopt;
        }
      }
      return Full(bytes);
    }
    api::Problem Full(std::uint64_t bytes) const;

    RequestMemory* memory_;
    std::uint64_t received_ = 0;
    std::shared_ptr<Held> held_;
  };

  /// The source of large blocks. Whoever takes one charges its bytes first.
  api::BlockSource* blocks() { return &pool_; }
  /// The largest body that can ever be held.
  std::uint64_t MostBodyBytes() const { return own_ - own_ / 4; }

  /// Held by requests now.
  std::uint64_t used() const;
  /// The part of it that is borrowed.
  std::uint64_t borrowed() const;
  /// Bytes of idle blocks. They are not in used().
  std::uint64_t kept() const { return pool_.kept_bytes(); }

 private:
  using Bodies = std::list<std::shared_ptr<Body::Held>>;
  /// The most bytes of idle blocks: a batch of about a million rays takes as much.
  static constexpr std::uint64_t kMostKeptBytes = std::uint64_t{64} << 20;

  /// What requests may hold while `lender_bytes` of the lender are in use.
  std::uint64_t MostBytes(std::uint64_t lender_bytes = 0) const {
    if (lender_ == nullptr) return own_;
    return own_ + std::min(own_, lender_->limit() - std::min(lender_->limit(), lender_bytes));
  }
  bool IsSmall(std::uint64_t bytes) const { return bytes <= own_ / 64; }

  api::Check Charge(std::uint64_t bytes, std::uint64_t total, api::ErrorCode never,
                    std::uint64_t lender_bytes);
  bool Borrow(std::uint64_t needed, std::unique_lock<std::mutex>* lock);
  api::Problem NeverFits(std::uint64_t bytes, std::uint64_t most, api::ErrorCode code,
                         std::uint64_t lender_bytes = 0) const;
  void Return(std::uint64_t bytes);
  bool Grow(Body::Held* body, std::uint64_t bytes);
  // With mutex_ held:
  // `returned`: bytes of other bodies that would be dropped first.
  bool FitsBodyLocked(std::uint64_t bytes, std::uint64_t total, std::uint64_t returned = 0) const;
  std::uint64_t BorrowedAt(std::uint64_t used) const;
  void UseLocked(std::uint64_t bytes);
  void ReturnLocked(std::uint64_t bytes);
  api::Problem FullLocked(std::uint64_t bytes) const;

  const std::uint64_t own_;
  core::MemoryBudget* const lender_;
  const std::chrono::milliseconds settle_time_;
  mutable std::mutex mutex_;
  mutable std::condition_variable returned_;  // memory came back
  std::uint64_t used_ = 0;
  core::MemoryCharge borrowed_;
  BlockPool pool_;  // before the bodies, which have blocks of it
  Bodies bodies_;   // bodies that may be dropped, oldest first
};

}  // namespace kdray::server
