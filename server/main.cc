// SPDX-License-Identifier: Apache-2.0
// kdrayd: reads its options, starts the backend and the server, and ends both when told to.
#include <fcntl.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <exception>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <utility>
#include <variant>

#include "core/base/fp_environment.h"
#include "server/config.h"
#include "server/core_backend.h"
#include "server/descriptor_limit.h"
#include "server/http/http_server.h"
#include "server/log.h"
#include "server/s3_store.h"
#include "server/service.h"

namespace kdray::server {
namespace {

/// Enough that 64 clients with small batches wait for a processor rather than for a turn.
constexpr std::size_t kShortFactor = 8;

/// Opens /dev/null in place of each standard stream that is closed. Otherwise the next file or
/// socket would get its number, and the log would be written into it.
void OpenStandardStreams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (fcntl(stream, F_GETFD) >= 0) continue;
    if (open("/dev/null", O_RDWR) != stream) return;  // the lowest number that is free
  }
}

/// Makes the process's size follow the memory that is reserved. By default the allocator keeps
/// freed blocks in an arena for each thread, up to twice the largest one that was ever freed. With
/// these limits, it keeps little of --memory-limit, and small blocks are still reused.
void LimitFreedMemory(const Config& config) {
  constexpr std::uint64_t kLeast = std::uint64_t{256} << 10, kMost = std::uint64_t{8} << 20;
  const int block = static_cast<int>(std::clamp(config.memory_limit_bytes / 256, kLeast, kMost));
  mallopt(M_MMAP_THRESHOLD, block);
  mallopt(M_TRIM_THRESHOLD, 2 * block);
  mallopt(M_ARENA_MAX, std::max(4, 2 * config.threads));
}

/// To be called before any thread is made, so that all of them leave the signals to
/// ServeUntilStopped().
sigset_t BlockSignals() {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);  // a file at its size limit is a full disk, not the end
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  return signals;
}

/// One line: whoever reads standard error expects one JSON object in each.
int Fail(const Log& log, const std::string& message) {
  log.Write(LogLevel::kError, "start_failed", {{"message", message}});
  return 1;
}

/// What the start found in the data directory and left as it was.
void LogFindings(const Log& log, const BackendCounters& counters) {
  if (counters.unrecorded_meshes != 0) {
    log.Write(LogLevel::kWarning, "unrecorded_meshes",
              {{"count", counters.unrecorded_meshes},
               {"message",
                "stored meshes without a tree are kept; uploading the same bytes "
                "makes trees of them again"}});
  }
  if (counters.unreadable_meshes != 0) {
    log.Write(LogLevel::kWarning, "unreadable_meshes",
              {{"count", counters.unreadable_meshes},
               {"message",
                "stored meshes of trees cannot be read; uploading the same bytes "
                "repairs them"}});
  }
}

core::Result<std::optional<BearerTokens>> ReadTokens(const std::filesystem::path& path) {
  if (path.empty()) return std::optional<BearerTokens>();
  std::ifstream file(path, std::ios::binary);
  std::string text;
  // A folder can be opened; only reading it fails.
  for (std::array<char, 4096> part{}; file.read(part.data(), part.size()) || file.gcount() > 0;) {
    text.append(part.data(), static_cast<std::size_t>(file.gcount()));
  }
  if (!file.is_open() || file.bad()) {
    return core::Error{core::ErrorCode::kIo, "cannot read " + path.string()};
  }
  auto tokens = BearerTokens::Parse(text);
  if (!tokens) {
    core::Error error = tokens.error();
    error.message = path.string() + ": " + error.message;
    return error;
  }
  return std::optional<BearerTokens>(*std::move(tokens));
}

/// On SIGHUP. An invalid file changes nothing: clients with the old tokens are not locked out.
void ReloadTokens(const Config& config, Service& service, const Log& log) {
  try {
    auto tokens = ReadTokens(config.token_file);
    if (!tokens) {
      log.Write(LogLevel::kError, "reload_failed", {{"message", tokens.error().message}});
      return;
    }
    if (*tokens) service.ReplaceTokens(**std::move(tokens));
    log.Write(LogLevel::kInfo, "reloaded", {{"tokens", !config.token_file.empty()}});
  } catch (const std::exception& error) {
    log.Write(LogLevel::kError, "reload_failed", {{"message", error.what()}});
  }
}

/// Returns the signal that ends the daemon.
int ServeUntilStopped(const sigset_t& signals, const std::function<void()>& reload) {
  for (;;) {
    int signal = 0;
    if (sigwait(&signals, &signal) != 0) continue;
    if (signal != SIGHUP) return signal;
    reload();
  }
}

/// Waits for the requests in work. A second signal to stop ends the wait.
bool WaitForRequests(HttpServer& server, sigset_t signals, std::int64_t timeout_ms) {
  using Clock = std::chrono::steady_clock;
  sigdelset(&signals, SIGHUP);
  const auto deadline = Clock::now() + std::chrono::milliseconds(timeout_ms);
  constexpr timespec kNoWait{.tv_sec = 0, .tv_nsec = 0};
  for (;;) {
    const auto next = std::min(deadline, Clock::now() + std::chrono::milliseconds(50));
    if (server.WaitUntilIdle(next)) return true;
    if (Clock::now() >= deadline || sigtimedwait(&signals, nullptr, &kNoWait) > 0) return false;
  }
}

std::string Url(const std::string& host, int port) {
  const bool is_v6 = host.find(':') != std::string::npos;
  return "http://" + (is_v6 ? "[" + host + "]" : host) + ":" + std::to_string(port);
}

core::Result<std::unique_ptr<core::ObjectStore>> OpenStore(const Config& config) {
  if (!config.store) return std::unique_ptr<core::ObjectStore>();
  return MakeS3Store(*config.store, [] { return ReadAwsSettings(ProcessEnvironment()); });
}

core::SharedTreesOptions SharedOptions(const Config& config, core::ObjectStore* store,
                                       const Log& log) {
  core::SharedTreesOptions shared;
  if (store == nullptr) return shared;
  shared.store = store;
  shared.name = config.store->ToString();
  shared.on_change = [&log](bool is_away, const std::string& why) {
    if (is_away) {
      log.Write(LogLevel::kWarning, "store_away", {{"message", why}});
    } else {
      log.Write(LogLevel::kInfo, "store_back", {});
    }
  };
  return shared;
}

int Serve(const Config& config, const sigset_t& signals, const Log& log) {
  if (const auto sound = core::CheckFloatingPointEnvironment(); !sound) {
    return Fail(log, sound.error().message);
  }
  auto tokens = ReadTokens(config.token_file);
  if (!tokens) return Fail(log, tokens.error().message);
  core::Result<std::unique_ptr<core::ObjectStore>> store = OpenStore(config);
  if (!store) return Fail(log, store.error().message);
  auto backend = MakeCoreBackend({.data_dir = config.data_dir,
                                  .threads = config.threads,
                                  .memory_limit_bytes = config.BackendMemoryBytes(),
                                  .store_limit_bytes = config.store_limit_bytes,
                                  .limits = config.limits,
                                  .shared = SharedOptions(config, store->get(), log)});
  if (!backend) {
    return Fail(log, "data directory " + config.data_dir.string() + ": " + backend.error().message);
  }
  LogFindings(log, (*backend)->counters());

  Service service({.limits = config.limits,
                   .max_running = config.max_running,
                   .short_factor = kShortFactor,
                   .max_queued = config.max_queued,
                   .request_memory_bytes = config.RequestMemoryBytes(),
                   .memory_lender = (*backend)->memory(),
                   .memory_limit_bytes = config.memory_limit_bytes,
                   .tokens = *std::move(tokens),
                   .cors = config.cors},
                  **backend, log);
  HttpServerOptions http;
  http.host = config.host;
  http.port = config.port;
  const DescriptorLimit limit = RaiseDescriptorLimit(config.max_connections);
  http.max_connections = limit.connections;
  if (limit.connections < config.max_connections) {
    log.Write(LogLevel::kWarning, "fewer_connections",
              {{"max_connections", std::uint64_t{config.max_connections}},
               {"connections", std::uint64_t{limit.connections}},
               {"message", "the hard limit of open files is " + std::to_string(limit.descriptors) +
                               "; max_connections needs " +
                               std::to_string(DescriptorsFor(config.max_connections))}});
  }
  HttpServer server(http, service);
  if (const auto problem = server.Bind()) return Fail(log, *problem);
  server.Start();
  const std::string url = Url(config.host, server.port());
  std::cout << "kdrayd listening on " << url << std::endl;
  log.Write(LogLevel::kInfo, "listening", {{"url", url}, {"version", KDRAY_VERSION}});

  const int signal = ServeUntilStopped(signals, [&] { ReloadTokens(config, service, log); });
  log.Write(LogLevel::kInfo, "draining", {{"signal", static_cast<std::uint64_t>(signal)}});
  // In this order, so that a connection that the service refuses has come after the server began.
  server.Drain();
  service.Drain();
  const bool finished = WaitForRequests(server, signals, config.drain_timeout_ms);
  if (!finished) server.CancelWork();
  server.Stop();
  (*backend)->Shutdown();
  log.Write(LogLevel::kInfo, "stopped", {{"finished", finished}});
  return 0;
}

int Run(const Config& config) {
  const sigset_t signals = BlockSignals();
  LimitFreedMemory(config);
  const Log log(STDERR_FILENO, config.log_level);
  try {
    return Serve(config, signals, log);
  } catch (const std::exception& error) {  // no thread or no memory at the start
    return Fail(log, error.what());
  }
}

}  // namespace
}  // namespace kdray::server

int main(int argc, char** argv) {
  kdray::server::OpenStandardStreams();
  try {
    auto parsed = kdray::server::ParseConfig(argc, argv);
    if (const auto* stop = std::get_if<kdray::server::ConfigExit>(&parsed)) {
      (stop->code == 0 ? std::cout : std::cerr) << stop->output;
      return stop->code;
    }
    return kdray::server::Run(std::get<kdray::server::Config>(parsed));
  } catch (const std::exception& error) {  // no memory, before there is a log
    std::fprintf(stderr, "kdrayd: %s\n", error.what());
    return 1;
  }
}
