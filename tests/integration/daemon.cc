// SPDX-License-Identifier: Apache-2.0
#include "tests/integration/daemon.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <thread>

extern char** environ;

namespace kdray::test {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kLook{2};

std::vector<char*> Pointers(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

}  // namespace

Daemon::Daemon(std::vector<std::string> options, std::vector<std::string> environment,
               std::optional<int> closed) {
  int out[2], err[2];
  if (pipe2(out, O_CLOEXEC) != 0 || pipe2(err, O_CLOEXEC) != 0) std::abort();
  for (char** variable = environ; *variable != nullptr; ++variable) {
    environment.emplace_back(*variable);
  }
  options.insert(options.begin(), KDRAY_DAEMON);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err[1], STDERR_FILENO);
  if (closed) posix_spawn_file_actions_addclose(&actions, *closed);
  const int failed = posix_spawn(&pid_, KDRAY_DAEMON, &actions, nullptr, Pointers(options).data(),
                                 Pointers(environment).data());
  posix_spawn_file_actions_destroy(&actions);
  EXPECT_EQ(failed, 0) << "cannot start " << KDRAY_DAEMON;
  close(out[1]);
  close(err[1]);
  out_ = out[0];
  err_ = err[0];
  fcntl(out_, F_SETFL, O_NONBLOCK);
  fcntl(err_, F_SETFL, O_NONBLOCK);
}

Daemon::~Daemon() {
  if (!exit_code_) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  close(out_);
  close(err_);
}

void Daemon::Drain(int fd, std::string& text) {
  char bytes[4096];
  for (ssize_t count = 0; (count = read(fd, bytes, sizeof(bytes))) > 0;) {
    text.append(bytes, static_cast<std::size_t>(count));
  }
}

std::string Daemon::output() {
  Drain(out_, out_text_);
  return out_text_;
}

void Daemon::StopReadingErrors() {
  errors();
  fcntl(err_, F_SETPIPE_SZ, 4096);
  reads_errors_ = false;
}

void Daemon::CloseErrors() {
  close(err_);
  err_ = -1;
}

std::string Daemon::errors() {
  reads_errors_ = true;
  Drain(err_, err_text_);
  return err_text_;
}

std::optional<int> Daemon::WaitForPort(std::chrono::seconds timeout) {
  const auto deadline = Clock::now() + timeout;
  while (Clock::now() < deadline) {
    const std::string text = output();
    Drain(err_, err_text_);
    if (const auto end = text.find('\n'); end != std::string::npos) {
      const auto colon = text.rfind(':', end);
      return std::atoi(text.c_str() + colon + 1);
    }
    if (WaitForExit(std::chrono::seconds(0)) != -2) return std::nullopt;
    std::this_thread::sleep_for(kLook);
  }
  return std::nullopt;
}

void Daemon::Signal(int signal) { kill(pid_, signal); }

int Daemon::WaitForExit(std::chrono::seconds timeout) {
  const auto deadline = Clock::now() + timeout;
  while (!exit_code_) {
    int status = 0;
    if (reads_errors_) Drain(err_, err_text_);
    if (waitpid(pid_, &status, WNOHANG) == pid_) {
      exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    } else if (Clock::now() >= deadline) {
      return -2;
    } else {
      std::this_thread::sleep_for(kLook);
    }
  }
  return *exit_code_;
}

}  // namespace kdray::test
