// SPDX-License-Identifier: Apache-2.0
#include "server/http/listener.h"

#include <fcntl.h>
#include <linux/filter.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

namespace kdray::server {
namespace {

using std::chrono::milliseconds;

/// Pause after an error of accept(), so that a lasting one takes no processor time.
constexpr milliseconds kErrorPause{2};
/// A handshake that has begun is complete after a round trip.
constexpr milliseconds kHandshakeTime{50};

int OpenSpare() { return open("/dev/null", O_RDONLY | O_CLOEXEC); }

/// Connections in the queue are reset when their socket is closed, with requests that the clients
/// have already sent. So the system first drops the segments that begin a connection: byte 13 of a
/// segment has its flags, 0x02 is SYN (RFC 9293, 3.1). Without permission for it, those that begin
/// in the last moment are reset.
void RefuseNewConnections(int fd) {
  std::array<sock_filter, 4> code = {{
      BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 13),
      BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, 0x02, 0, 1),
      BPF_STMT(BPF_RET | BPF_K, 0),
      BPF_STMT(BPF_RET | BPF_K, 0xffffffff),
  }};
  const sock_fprog program{.len = static_cast<unsigned short>(code.size()), .filter = code.data()};
  setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof(program));
}

}  // namespace

Listener::Listener(int fd, int backlog, Events events)
    : events_(std::move(events)),
      fd_(fd),
      wake_fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      spare_fd_(OpenSpare()) {
  // Not blocking: a connection may have left the queue when it is accepted.
  if (wake_fd_ < 0 || fcntl(fd_, F_SETFL, fcntl(fd_, F_GETFL) | O_NONBLOCK) != 0 ||
      listen(fd_, backlog) != 0) {
    const int error = errno;
    Stop();
    throw std::system_error(error, std::generic_category(), "listen");
  }
}

Listener::~Listener() { Stop(); }

void Listener::Start() {
  thread_ = std::thread([this] { Run(); });
}

void Listener::Wake() {
  ticks_ = true;
  [[maybe_unused]] const int failed = eventfd_write(wake_fd_, 1);
}

void Listener::CloseQueue() {
  RefuseNewConnections(fd_);
  Sleep(kHandshakeTime);
  pollfd entry{.fd = fd_, .events = POLLIN, .revents = 0};
  for (int i = 0; i < 100 && poll(&entry, 1, 0) > 0; ++i) Sleep(kErrorPause);
}

void Listener::Stop() {
  stopping_ = true;
  if (thread_.joinable()) {
    Wake();
    thread_.join();
  }
  for (int* fd : {&fd_, &wake_fd_, &spare_fd_}) {
    if (*fd >= 0) close(std::exchange(*fd, -1));
  }
}

void Listener::Run() noexcept {
  while (!stopping_) {
    std::array entries = {pollfd{.fd = fd_, .events = POLLIN, .revents = 0},
                          pollfd{.fd = wake_fd_, .events = POLLIN, .revents = 0}};
    poll(entries.data(), entries.size(), ticks_ ? static_cast<int>(kTick.count()) : -1);
    if (entries[1].revents != 0) {
      eventfd_t wakes = 0;
      [[maybe_unused]] const int failed = eventfd_read(wake_fd_, &wakes);
    }
    if (ticks_) events_.tick();
    for (;;) {
      const Accepted accepted = stopping_ ? Accepted::kNone : AcceptOne();
      if (accepted == Accepted::kNone) break;
      if (accepted == Accepted::kFailed) Sleep(kErrorPause);
    }
  }
}

Listener::Accepted Listener::AcceptOne() noexcept {
  const int fd = accept4(fd_, nullptr, nullptr, SOCK_CLOEXEC);
  if (fd >= 0) {
    events_.accepted(fd);
    return Accepted::kOne;
  }
  switch (errno) {
    case EAGAIN:
      return Accepted::kNone;
    case EMFILE:
    case ENFILE:
    case ENOBUFS:
    case ENOMEM:
      MakeRoom();
      return Accepted::kFailed;
    case EINTR:
    case ECONNABORTED:
      return Accepted::kOne;  // the next one may be fine
    default:
      return Accepted::kFailed;
  }
}

void Listener::MakeRoom() noexcept {
  if (spare_fd_ < 0) spare_fd_ = OpenSpare();
  if (events_.exhausted() || spare_fd_ < 0) return;
  close(std::exchange(spare_fd_, -1));
  if (const int fd = accept4(fd_, nullptr, nullptr, SOCK_CLOEXEC); fd >= 0) events_.refused(fd);
}

void Listener::Sleep(milliseconds time) const noexcept {
  if (stopping_) return;
  poll(nullptr, 0, static_cast<int>(time.count()));
}

}  // namespace kdray::server
