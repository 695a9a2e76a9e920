// SPDX-License-Identifier: Apache-2.0
// The command line and the environment.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <variant>

#include "api/limits.h"
#include "server/aws_settings.h"
#include "server/cors.h"
#include "server/log.h"

namespace kdray::server {

struct Config {
  std::string host = "127.0.0.1";
  int port = 8080;  ///< 0 picks a free one
  std::filesystem::path data_dir = "kdray-data";
  std::optional<StoreUrl> store;  ///< that replicas share
  int threads = 1;                ///< default: the number of hardware threads
  std::uint64_t memory_limit_bytes = std::uint64_t{4} << 30;
  std::optional<std::uint64_t> store_limit_bytes;
  api::Limits limits;
  std::size_t max_connections = 1024;
  std::size_t max_running = 2;  ///< default: threads, at least 2
  std::size_t max_queued = 128;
  std::filesystem::path token_file;  ///< empty: no tokens
  CorsPolicy cors;                   ///< default: pages of other origins read nothing
  std::int64_t drain_timeout_ms = 25000;
  LogLevel log_level = LogLevel::kInfo;

  /// Of the memory beside the process's own, meshes, trees and builds get three quarters, running
  /// requests the rest.
  std::uint64_t BackendMemoryBytes() const { return SharedMemoryBytes() / 4 * 3; }
  std::uint64_t RequestMemoryBytes() const { return SharedMemoryBytes() / 4; }

 private:
  /// Code, threads, connections, and what the allocator keeps.
  static constexpr std::uint64_t kProcessBytes = std::uint64_t{32} << 20;
  std::uint64_t SharedMemoryBytes() const {
    return memory_limit_bytes - std::min(kProcessBytes, memory_limit_bytes / 8);
  }
};

/// A command line that ends the program: --help and --version with 0, an invalid option with 2.
struct ConfigExit {
  int code = 0;
  std::string output;  ///< for standard output if code is 0, else for standard error
};

/// Every option may also be set in the environment, `--data-dir DIR` as KDRAY_DATA_DIR; the command
/// line takes precedence.
std::variant<Config, ConfigExit> ParseConfig(int argc, const char* const* argv);

}  // namespace kdray::server
