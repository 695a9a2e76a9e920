// SPDX-License-Identifier: Apache-2.0
// Measures the time from the cancellation of a running call to its end, in processor time of the
// calling thread, so a busy machine does not change it; the call runs on that thread alone. With
// KDRAY_CANCEL_WALL=1, which tests/cancellation sets, in wall-clock time.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/base/result.h"

namespace kdray::test {

/// Every call must end within this time after its cancellation. A sanitizer makes the code several
/// times slower.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr std::chrono::milliseconds kPromptly{1000};
#else
inline constexpr std::chrono::milliseconds kPromptly{250};
#endif

/// Processor time of the calling thread; with KDRAY_CANCEL_WALL=1, the time of a clock.
std::chrono::nanoseconds ThreadTime();

/// The factor of the inputs' size: 1, and more with KDRAY_CANCEL_WALL=1.
std::size_t CancelScale();

struct CancelledCall {
  /// False if the call ended before its cancellation; then it proves nothing.
  bool was_cancelled = false;
  std::chrono::nanoseconds late{0};  ///< from the cancellation to the return
  core::Status status;
};

/// Calls Cancel() on a token from another thread after this thread has worked for `after`.
class CancelAfter {
 public:
  explicit CancelAfter(std::chrono::milliseconds after);
  ~CancelAfter();
  CancelAfter(const CancelAfter&) = delete;
  CancelAfter& operator=(const CancelAfter&) = delete;

  const core::CancelToken& token() const { return token_; }
  /// Call once, after the work.
  CancelledCall Finish(core::Status status);

 private:
  struct Watcher;
  core::CancelToken token_ = core::CancelToken::Cancellable();
  std::unique_ptr<Watcher> watcher_;
};

/// Runs call(token), which returns a Status, and cancels it after the given work.
template <class Call>
CancelledCall CancelDuring(std::chrono::milliseconds after, const Call& call) {
  CancelledCall result;
  core::Arena(1).Run([&] {
    CancelAfter cancel(after);
    core::Status status = call(cancel.token());
    result = cancel.Finish(std::move(status));
  });
  return result;
}

/// Fails unless the call was cancelled while it ran, ended promptly, and returned the cancellation.
/// `what` names it in the message.
void ExpectPrompt(const CancelledCall& call, const std::string& what);

/// A token that stops at its n-th check, counted from 1.
core::CancelToken CancelledAtLook(std::uint64_t n);

/// Success, or the error of a Result.
template <class T>
core::Status StatusOf(const core::Result<T>& result) {
  return result.ok() ? core::Status() : core::Status(result.error());
}

}  // namespace kdray::test
