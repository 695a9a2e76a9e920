// SPDX-License-Identifier: Apache-2.0
// core/base/parallel.h on plain threads, for ThreadSanitizer. oneTBB's library is not instrumented,
// so the sanitizer reports false positives inside it. Suppressing them would also suppress our own
// races in the same frames. With threads of the standard library every report is about our own
// code. Simple and slow: each call creates threads, and a nested call is serial.
#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>

namespace kdray::core::parallel_backend {

/// True where a call must do all its work on the calling thread.
inline thread_local bool serial = false;

class SerialScope {
 public:
  explicit SerialScope(bool on) : before_(serial) { serial = on; }
  ~SerialScope() { serial = before_; }
  SerialScope(const SerialScope&) = delete;
  SerialScope& operator=(const SerialScope&) = delete;

 private:
  bool before_;
};

class Workers {
 public:
  explicit Workers(int threads) : threads_(threads) {}
  template <class F>
  void Run(F&& f) {
    const SerialScope scope(serial || threads_ == 1);
    f();
  }

 private:
  int threads_;
};

template <class F, class G>
void Both(F&& f, G&& g) {
  if (serial) {
    f();
    g();
    return;
  }
  std::exception_ptr failure;
  std::thread other([&] {
    const SerialScope scope(true);
    try {
      g();
    } catch (...) {
      failure = std::current_exception();
    }
  });
  std::exception_ptr own_failure;
  try {
    const SerialScope scope(true);
    f();
  } catch (...) {
    own_failure = std::current_exception();
  }
  other.join();
  if (own_failure) std::rethrow_exception(own_failure);
  if (failure) std::rethrow_exception(failure);
}

template <class Task>
void ForEach(std::size_t count, const Task& task) {
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) task(i);
  };
  Both(work, work);
}

}  // namespace kdray::core::parallel_backend
