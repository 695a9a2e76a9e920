// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/output_file.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <ostream>
#include <utility>

#include "kdray/error.h"

namespace kdray::client {
namespace {

// The file that the signal handler unlinks: a plain array, because a handler may access little
// else. The flag is set after the name is complete and cleared before the name changes.
char unfinished_path[PATH_MAX];
volatile std::sig_atomic_t has_unfinished_file = 0;

void SetUnfinished(const std::string& path) {
  has_unfinished_file = 0;
  if (path.empty() || path.size() >= sizeof unfinished_path) return;
  std::memcpy(unfinished_path, path.c_str(), path.size() + 1);
  has_unfinished_file = 1;
}

extern "C" void RemoveAndDie(int signal) {
  if (has_unfinished_file) unlink(unfinished_path);
  // SA_RESETHAND has restored the default action, so the shell sees that a signal ended us.
  raise(signal);
}

}  // namespace

void RemoveUnfinishedFilesOnSignals() {
  struct sigaction action {};
  action.sa_handler = RemoveAndDie;
  action.sa_flags = static_cast<int>(SA_RESETHAND) | SA_NODEFER;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction before {};
    // Keeps a parent's choice to ignore SIGHUP (nohup).
    if (sigaction(signal, nullptr, &before) == 0 && before.sa_handler != SIG_IGN)
      sigaction(signal, &action, nullptr);
  }
}

void CheckOutput(Console& console) {
  if (console.out) return;
  // The stream does not tell why it failed; a pipe without a reader reports an error by itself.
  pollfd standard_output = {.fd = STDOUT_FILENO, .events = POLLOUT, .revents = 0};
  if (poll(&standard_output, 1, 0) == 1 && (standard_output.revents & POLLERR) != 0) {
    throw ClosedPipe();
  }
  throw LocalFileError("standard output: cannot be written");
}

OutputFile::OutputFile(std::string path, Console& console)
    : path_(std::move(path)), console_(console) {
  if (path_ == "-") {
    if (console.out_is_terminal)
      throw LocalFileError("standard output is a terminal; name a file with -o, or pipe it on");
    return;
  }
  struct stat status {};
  if (stat(path_.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
    descriptor_ = open(path_.c_str(), O_WRONLY | O_CLOEXEC);
    if (descriptor_ < 0) Fail();
    return;
  }
  temporary_ = path_ + ".XXXXXX";
  descriptor_ = mkostemp(temporary_.data(), O_CLOEXEC);
  if (descriptor_ < 0) {
    temporary_.clear();
    Fail();
  }
  SetUnfinished(temporary_);
}

OutputFile::~OutputFile() {
  if (descriptor_ >= 0) close(descriptor_);
  if (temporary_.empty()) return;
  SetUnfinished({});
  unlink(temporary_.c_str());
}

void OutputFile::Fail() const { throw LocalFileError(path_ + ": " + std::strerror(errno)); }

void OutputFile::Write(std::string_view bytes) {
  if (descriptor_ < 0) {
    console_.out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    CheckOutput(console_);
    return;
  }
  while (!bytes.empty()) {
    const ssize_t written = write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0 && errno == EPIPE) throw ClosedPipe();  // /dev/stdout, a named pipe
    if (written < 0) Fail();
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void OutputFile::Commit() {
  if (descriptor_ < 0) return;
  if (!temporary_.empty()) {
    // mkostemp creates files for the owner alone; a result gets the usual permissions.
    const mode_t mask = umask(0);
    umask(mask);
    if (fchmod(descriptor_, 0666 & ~mask) != 0) Fail();
  }
  const int descriptor = std::exchange(descriptor_, -1);
  if (close(descriptor) != 0) Fail();  // a network file system may report a full disk here
  if (temporary_.empty()) return;
  if (rename(temporary_.c_str(), path_.c_str()) != 0) Fail();
  SetUnfinished({});
  temporary_.clear();
}

}  // namespace kdray::client
