// The memory that requests under way hold together: bodies that come in, what is made from them,
// images. Beyond it a client is told at once to come back.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <utility>

#include "api/types.h"

namespace kdray::server {

/// Memory is taken when it is needed: for work when the work begins, for a body as its bytes
/// arrive. A length that a client declares takes nothing, so it can only cause its own request to
/// be refused.
///
/// Bodies are ordered by their beginning. A body that meets a full budget does not wait: newer
/// bodies give way to it, the newest first, if what they hold is enough; otherwise it is refused
/// itself. A body that gave way frees its bytes at once and is refused at its next piece.
///
/// A request that needs more than the whole budget gets in while nothing else holds any: other
/// limits (api/limits.h) say what is too large. Safe from many threads at once.
class RequestMemory {
 public:
  explicit RequestMemory(std::uint64_t limit_bytes) : limit_(limit_bytes) {}

  /// Some of the budget, for as long as it lives.
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
    ~Share() {
      if (memory_ != nullptr) memory_->Return(bytes_);
    }

   private:
    friend class RequestMemory;
    Share(RequestMemory* memory, std::uint64_t bytes) : memory_(memory), bytes_(bytes) {}
    RequestMemory* memory_ = nullptr;
    std::uint64_t bytes_ = 0;
  };

  /// memory_full when `bytes` are not free now.
  api::Outcome<Share> Take(std::uint64_t bytes);
  /// The problem that Take(bytes) would answer now; takes nothing.
  api::Check Check(std::uint64_t bytes) const;

  /// A body on its way in. One thread at a time.
  class Body {
   public:
    /// Each byte counts `per_byte` bytes of the budget, for what will be made from the body.
    Body(RequestMemory* memory, std::uint64_t per_byte);
    Body(const Body&) = delete;
    Body& operator=(const Body&) = delete;
    ~Body();

    /// memory_full when this body has to give way; then it stays refused.
    api::Check Append(std::span<const std::byte> piece);

    struct Whole {
      std::string text;
      Share share;
    };
    /// The body is complete and gives way no more. memory_full when it had to before. Call once.
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
  Bodies bodies_;  // that may have to give way, oldest first
};

}  // namespace kdray::server
