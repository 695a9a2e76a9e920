// Notices clients that leave while their query or render is computed, so that nobody computes for
// no one.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <thread>

#include "core/base/cancel.h"

namespace kdray::server {

/// One thread that sleeps until a watched socket is closed by its client. Safe from many threads at
/// once.
class DepartureWatch {
 public:
  DepartureWatch();
  /// Every handle must be gone by then.
  ~DepartureWatch();
  DepartureWatch(const DepartureWatch&) = delete;
  DepartureWatch& operator=(const DepartureWatch&) = delete;

  /// Cancels `token` when the other side of the socket closes, or has closed its sending half. Ends
  /// with the handle, which must go before the socket is closed.
  std::shared_ptr<void> Watch(int fd, const core::CancelToken& token);

 private:
  struct Entry {
    int fd;
    core::CancelToken token;
  };
  void Run();
  void Wake() const;
  void Forget(std::uint64_t id);

  int wake_fd_;
  std::mutex mutex_;
  std::map<std::uint64_t, Entry> entries_;
  std::uint64_t next_id_ = 0;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace kdray::server
