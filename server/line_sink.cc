// SPDX-License-Identifier: Apache-2.0
#include "server/line_sink.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>

namespace kdray::server {
namespace {

using std::chrono::milliseconds;

/// Poll interval of a wait, because Stop() does not wake it.
constexpr milliseconds kLook{50};
/// A pipe that poll() calls writable takes this much without waiting, and all of it or nothing.
constexpr std::size_t kPieceBytes = PIPE_BUF;

mode_t KindOf(int fd) {
  struct stat status {};
  return fstat(fd, &status) == 0 ? status.st_mode & S_IFMT : 0;
}

}  // namespace

LineSink::LineSink(int fd)
    : fd_(fd), is_socket_(KindOf(fd) == S_IFSOCK), is_pipe_(KindOf(fd) == S_IFIFO) {}

void LineSink::Stop() noexcept {
  stop_by_ = Clock::now() + kStopTime;
  stopping_ = true;
}

bool LineSink::Write(std::string_view line) noexcept {
  if (is_cut_) is_cut_ = !WriteAll("\n");
  return !is_cut_ && WriteAll(line);
}

bool LineSink::WriteAll(std::string_view bytes) noexcept {
  const std::size_t size = bytes.size();
  while (!bytes.empty() && !gave_up_) {
    if (!WaitUntilWritable()) {
      gave_up_ = true;
      break;
    }
    const long count = WriteSome(bytes.substr(0, kPieceBytes));
    if (count >= 0) {
      bytes.remove_prefix(static_cast<std::size_t>(count));
    } else if (errno != EAGAIN && errno != EINTR) {
      break;
    }
  }
  if (!bytes.empty() && bytes.size() < size) is_cut_ = true;
  return bytes.empty();
}

bool LineSink::WaitUntilWritable() const noexcept {
  const auto start = Clock::now();
  for (;;) {
    if (stopping_ && Clock::now() >= stop_by_.load()) return false;
    pollfd entry{.fd = fd_, .events = POLLOUT, .revents = 0};
    const int ready = poll(&entry, 1, static_cast<int>(kLook.count()));
    if (ready > 0 || (ready < 0 && errno != EINTR)) return true;  // an error shows when writing
    if (stopping_ && Clock::now() - start >= kStallTime) return false;
  }
}

long LineSink::WriteSome(std::string_view bytes) const noexcept {
  if (is_socket_) return send(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  if (is_pipe_) {
    // Another process may have filled the pipe since poll(). Not every kernel can tell: Linux
    // before 6.4 says EOPNOTSUPP.
    const iovec piece{.iov_base = const_cast<char*>(bytes.data()), .iov_len = bytes.size()};
    const ssize_t count = pwritev2(fd_, &piece, 1, -1, RWF_NOWAIT);
    if (count >= 0 || errno != EOPNOTSUPP) return count;
  }
  return write(fd_, bytes.data(), bytes.size());
}

}  // namespace kdray::server
