// SPDX-License-Identifier: Apache-2.0
#include "core/store/retrying_store.h"

#include <algorithm>
#include <thread>
#include <utility>

namespace kdray::core {
namespace {

// Poll interval; a CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};

bool IsPassing(const Error& error) {
  return IsStoreAway(error) || error.code == ErrorCode::kCorrupt;
}

bool IsCancelled(const Error& error) {
  return error.code == ErrorCode::kCancelled || error.code == ErrorCode::kDeadlineExceeded;
}

}  // namespace

template <class Call>
auto RetryingStore::Repeat(const CancelToken& cancel, const Call& call) -> decltype(call()) {
  const std::optional<int> attempts = AttemptsNow();
  if (!attempts) return StoreIsAway("the store does not answer; it is asked again soon");
  for (int attempt = 1;; ++attempt) {
    const Clock::time_point began = Clock::now();
    auto answer = call();
    if (answer.ok() || !IsPassing(answer.error())) {
      if (answer.ok() || !IsCancelled(answer.error())) NoteAnswer();
      return answer;
    }
    if (attempt < *attempts) {
      if (!Sleep(attempt, cancel)) return cancel.ToError();
      continue;
    }
    // An altered answer is an answer.
    if (answer.error().code == ErrorCode::kCorrupt) {
      NoteAnswer();
    } else {
      NoteFailure(answer.error(), began);
    }
    return answer;
  }
}

std::optional<int> RetryingStore::AttemptsNow() {
  const std::lock_guard lock(mutex_);
  if (!is_away_) return rule_.attempts;
  const Clock::time_point now = Clock::now();
  if (now >= paused_until_) {
    // The others do not wait for this one, which may hang. If it does not end, another one tries
    // after the same time.
    paused_until_ = now + pause_;
    return 1;
  }
  ++counts_.failures;
  return std::nullopt;
}

bool RetryingStore::Sleep(int attempt, const CancelToken& cancel) {
  Clock::time_point until;
  {
    const std::lock_guard lock(mutex_);
    ++counts_.retries;
    const auto bound =
        std::min(rule_.most_backoff, rule_.first_backoff * (1 << std::min(attempt - 1, 16)));
    std::uniform_int_distribution<std::int64_t> backoff(0, bound.count());
    until = Clock::now() + std::chrono::milliseconds(backoff(random_));
  }
  for (;;) {
    if (cancel.ShouldStop()) return false;
    const auto now = Clock::now();
    if (now >= until) return true;
    std::this_thread::sleep_until(std::min(until, now + kLookAgain));
  }
}

void RetryingStore::NoteAnswer() {
  {
    const std::lock_guard lock(mutex_);
    pause_ = std::chrono::milliseconds(0);
    answered_ = Clock::now();
    if (!std::exchange(is_away_, false)) return;
  }
  if (on_change_) on_change_(false, "");
}

void RetryingStore::NoteFailure(const Error& error, Clock::time_point began) {
  {
    const std::lock_guard lock(mutex_);
    ++counts_.failures;
    // The store has answered another call since, so it is not away.
    if (answered_ > began) return;
    pause_ = std::clamp(2 * pause_, rule_.first_pause, rule_.most_pause);
    paused_until_ = Clock::now() + pause_;
    if (std::exchange(is_away_, true)) return;
  }
  if (on_change_) on_change_(true, error.message);
}

bool RetryingStore::IsAway() const {
  const std::lock_guard lock(mutex_);
  return is_away_ && Clock::now() < paused_until_;
}

RetryingStore::Counts RetryingStore::counts() const {
  const std::lock_guard lock(mutex_);
  Counts counts = counts_;
  counts.is_away = is_away_;
  return counts;
}

Result<ObjectPage> RetryingStore::List(std::string_view prefix, std::string_view after,
                                       std::size_t limit, const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->List(prefix, after, limit, cancel); });
}

Result<ObjectInfo> RetryingStore::Head(std::string_view key, const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->Head(key, cancel); });
}

Status RetryingStore::Get(std::string_view key, std::uint64_t offset, std::span<std::byte> out,
                          const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->Get(key, offset, out, cancel); });
}

Status RetryingStore::Put(std::string_view key, std::span<const std::byte> bytes, PutMode mode,
                          const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->Put(key, bytes, mode, cancel); });
}

Status RetryingStore::Delete(std::string_view key, const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->Delete(key, cancel); });
}

Result<std::string> RetryingStore::BeginParts(std::string_view key, const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->BeginParts(key, cancel); });
}

Result<std::string> RetryingStore::PutPart(std::string_view key, std::string_view upload,
                                           int number, std::span<const std::byte> bytes,
                                           const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->PutPart(key, upload, number, bytes, cancel); });
}

Status RetryingStore::FinishParts(std::string_view key, std::string_view upload,
                                  std::span<const std::string> tags, PutMode mode,
                                  const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->FinishParts(key, upload, tags, mode, cancel); });
}

Status RetryingStore::AbortParts(std::string_view key, std::string_view upload,
                                 const CancelToken& cancel) {
  return Repeat(cancel, [&] { return store_->AbortParts(key, upload, cancel); });
}

}  // namespace kdray::core
