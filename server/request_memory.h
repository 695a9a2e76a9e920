// SPDX-License-Identifier: Apache-2.0
// The memory of all running requests: bodies, the data made from them, pictures, and answers until
// they are sent. It is a part of --memory-limit. Beyond it, requests fail within milliseconds.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <utility>

#include "api/types.h"
#include "core/library/memory_budget.h"
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
/// Safe from many threads at once.
class RequestMemory {
 public:
  /// `lender`, which must outlive this object, is the budget of trees; null: nothing is borrowed.
  explicit RequestMemory(std::uint64_t own_bytes, core::MemoryBudget* lender = nullptr)
      : own_(own_bytes), lender_(lender) {}

  /// A part of the budget, returned when destroyed.
  class Share {
   public:
    Share() = default;
    Share(Share&& other) noexcept
        : memory_(std::exchange(other.memory_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
    Share& operator=(Share&& other) noexcept {
      std::swap(memory_, other.memory_);
      std::swap(bytes_, other.bytes_);
      return *this;
    }
    std::uint64_t bytes() const { return bytes_; }
    /// Returns what is above `bytes`.
    void ShrinkTo(std::uint64_t bytes) {
      if (bytes < bytes_) memory_->Return(std::exchange(bytes_, bytes) - bytes);
    }
    /// Adds `bytes`, or fails without a change: with `never` if so many can never be held together,
    /// with memory_full if they are not free now.
    api::Check Grow(std::uint64_t bytes, api::ErrorCode never);
    ~Share() {
      if (memory_ != nullptr) memory_->Return(bytes_);
    }

   private:
    friend class RequestMemory;
    Share(RequestMemory* memory, std::uint64_t bytes) : memory_(memory), bytes_(bytes) {}
    RequestMemory* memory_ = nullptr;
    std::uint64_t bytes_ = 0;
  };

  /// A share of `bytes`; the problems of Share::Grow().
  api::Outcome<Share> Take(std::uint64_t bytes, api::ErrorCode never);
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

    struct Whole {
      GrowingBytes text;
      Share share;  ///< of the text's bytes
    };
    /// The body is complete and cannot be dropped any more. memory_full if it was dropped before.
    /// Call once.
    api::Outcome<Whole> Finish();

   private:
    friend class RequestMemory;
    struct Held;

    RequestMemory* memory_;
    std::uint64_t received_ = 0;
    std::shared_ptr<Held> held_;
  };

  /// Held by requests now.
  std::uint64_t used() const;
  /// The part of it that is borrowed.
  std::uint64_t borrowed() const;

 private:
  using Bodies = std::list<std::shared_ptr<Body::Held>>;

  std::uint64_t MostBytes() const { return lender_ == nullptr ? own_ : 2 * own_; }
  std::uint64_t MostBodyBytes() const { return own_ - own_ / 4; }
  bool IsSmall(std::uint64_t bytes) const { return bytes <= own_ / 64; }

  api::Check Charge(std::uint64_t bytes, std::uint64_t total, api::ErrorCode never);
  bool Borrow(std::uint64_t needed, std::unique_lock<std::mutex>* lock);
  api::Problem NeverFits(std::uint64_t bytes, std::uint64_t most, api::ErrorCode code) const;
  void Return(std::uint64_t bytes);
  bool Grow(Body::Held* body, std::uint64_t bytes);
  // With mutex_ held:
  // `returned`: bytes of other bodies that would be dropped first.
  bool FitsBodyLocked(std::uint64_t bytes, std::uint64_t total, std::uint64_t returned = 0) const;
  std::uint64_t BorrowedAt(std::uint64_t used) const;
  void ReturnLocked(std::uint64_t bytes);
  api::Problem FullLocked(std::uint64_t bytes) const;

  const std::uint64_t own_;
  core::MemoryBudget* const lender_;
  mutable std::mutex mutex_;
  mutable std::condition_variable returned_;  // memory came back
  std::uint64_t used_ = 0;
  core::MemoryCharge borrowed_;
  Bodies bodies_;  // bodies that may be dropped, oldest first
};

}  // namespace kdray::server
