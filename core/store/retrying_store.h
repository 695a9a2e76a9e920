// SPDX-License-Identifier: Apache-2.0
// An object store that repeats what fails for a passing reason, and refuses at once while the store
// under it is away.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <string_view>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/store/object_store.h"

namespace kdray::core {

/// Repeats calls that end with StoreIsAway or kCorrupt, after a random time up to a bound that
/// doubles ("full jitter": Brooker, "Exponential Backoff and Jitter", AWS Architecture Blog, 2015).
///
/// After a call that failed in all attempts the store is away until a call succeeds. Calls fail at
/// once, so requests do not queue up for a store that is down, or accepts requests and answers
/// none. After each pause one call tries, once. Safe from many threads at once.
class RetryingStore final : public ObjectStore {
 public:
  struct Rule {
    int attempts = 4;
    std::chrono::milliseconds first_backoff{50};
    std::chrono::milliseconds most_backoff{2000};
    std::chrono::milliseconds first_pause{500};
    std::chrono::milliseconds most_pause{5000};
  };
  struct Counts {
    std::uint64_t retries = 0;   ///< repeated attempts
    std::uint64_t failures = 0;  ///< calls that failed in all attempts, or at once
    bool is_away = false;        ///< now
  };
  /// `on_change` is called when the store goes away (with the reason) and when it is back (empty);
  /// from any thread, without a lock. `store` must outlive this.
  using OnChange = std::function<void(bool is_away, const std::string& why)>;
  RetryingStore(ObjectStore* store, const Rule& rule, OnChange on_change)
      : store_(store), rule_(rule), on_change_(std::move(on_change)) {}

  /// Whether a call would fail at once now.
  bool IsAway() const;
  Counts counts() const;

  std::int64_t NowMs() const override { return store_->NowMs(); }
  Result<ObjectPage> List(std::string_view prefix, std::string_view after, std::size_t limit,
                          const CancelToken& cancel) override;
  Result<ObjectInfo> Head(std::string_view key, const CancelToken& cancel) override;
  Status Get(std::string_view key, std::uint64_t offset, std::span<std::byte> out,
             const CancelToken& cancel) override;
  Status Put(std::string_view key, std::span<const std::byte> bytes, PutMode mode,
             const CancelToken& cancel) override;
  Status Delete(std::string_view key, const CancelToken& cancel) override;
  Result<std::string> BeginParts(std::string_view key, const CancelToken& cancel) override;
  Result<std::string> PutPart(std::string_view key, std::string_view upload, int number,
                              std::span<const std::byte> bytes, const CancelToken& cancel) override;
  Status FinishParts(std::string_view key, std::string_view upload,
                     std::span<const std::string> tags, PutMode mode,
                     const CancelToken& cancel) override;
  Status AbortParts(std::string_view key, std::string_view upload,
                    const CancelToken& cancel) override;

 private:
  using Clock = std::chrono::steady_clock;
  template <class Call>
  auto Repeat(const CancelToken& cancel, const Call& call) -> decltype(call());
  // nullopt in a pause.
  std::optional<int> AttemptsNow();
  bool Sleep(int attempt, const CancelToken& cancel);
  void NoteAnswer();
  // Of a call whose last attempt began then.
  void NoteFailure(const Error& error, Clock::time_point began);

  ObjectStore* const store_;
  const Rule rule_;
  const OnChange on_change_;

  mutable std::mutex mutex_;
  std::mt19937_64 random_{std::random_device{}()};
  Counts counts_;
  bool is_away_ = false;
  std::chrono::milliseconds pause_{0};
  Clock::time_point paused_until_;
  Clock::time_point answered_ = Clock::time_point::min();  // the last answer
};

}  // namespace kdray::core
