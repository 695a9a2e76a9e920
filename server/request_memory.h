// The memory limit of all running requests: bodies, the data made from them, images. Beyond it,
// requests fail at once with `memory_full`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <utility>

#include "api/types.h"
#include "server/growing_bytes.h"

namespace kdray::server {

/// Memory is charged when it is needed: for work when it begins, for a body as its bytes arrive. A
/// declared length charges nothing, so it can only make its own request fail.
///
/// Bodies are ordered by their start. A body that meets a full budget does not wait: newer bodies
/// are dropped for it, the newest first, if they hold enough; otherwise it fails itself. A dropped
/// body frees its bytes at once, and its request fails at its next piece.
///
/// A request that needs more than the whole budget is accepted while nothing else holds memory:
/// other limits (api/limits.h) bound single requests. Safe from many threads at once.
class RequestMemory {
 public:
  explicit RequestMemory(std::uint64_t limit_bytes) : limit_(limit_bytes) {}

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
    /// memory_full if `bytes` more are not free now; then nothing has changed.
    api::Check Grow(std::uint64_t bytes);
    ~Share() {
      if (memory_ != nullptr) memory_->Return(bytes_);
    }

   private:
    friend class RequestMemory;
    Share(RequestMemory* memory, std::uint64_t bytes) : memory_(memory), bytes_(bytes) {}
    RequestMemory* memory_ = nullptr;
    std::uint64_t bytes_ = 0;
  };

  /// memory_full if `bytes` are not free now.
  api::Outcome<Share> Take(std::uint64_t bytes);
  /// The problem that Take(bytes) would return now; charges nothing.
  api::Check Check(std::uint64_t bytes) const;

  /// A body that is being received. For one thread at a time.
  class Body {
   public:
    /// Each byte is charged as `per_byte` bytes, for the data that will be made from the body.
    Body(RequestMemory* memory, std::uint64_t per_byte);
    Body(const Body&) = delete;
    Body& operator=(const Body&) = delete;
    ~Body();

    /// memory_full if this body was dropped; it stays so.
    api::Check Append(std::span<const std::byte> piece);

    struct Whole {
      GrowingBytes text;
      Share share;
    };
    /// The body is complete and cannot be dropped any more. memory_full if it was dropped before.
    /// Call once.
    api::Outcome<Whole> Finish();

   private:
    friend class RequestMemory;
    struct Held;

    RequestMemory* memory_;
    const std::uint64_t per_byte_;
    std::shared_ptr<Held> held_;
  };

  std::uint64_t used() const;

 private:
  using Bodies = std::list<std::shared_ptr<Body::Held>>;

  void Return(std::uint64_t bytes);
  bool Grow(Body::Held* body, std::uint64_t bytes);
  // With mutex_ held:
  bool FitsLocked(std::uint64_t bytes) const { return bytes <= limit_ && used_ <= limit_ - bytes; }
  api::Problem FullLocked(std::uint64_t bytes) const;

  const std::uint64_t limit_;
  mutable std::mutex mutex_;
  std::uint64_t used_ = 0;
  Bodies bodies_;  // bodies that may be dropped, oldest first
};

}  // namespace kdray::server
