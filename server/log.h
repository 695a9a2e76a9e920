// SPDX-License-Identifier: Apache-2.0
// The log: one JSON object per line. A separate thread writes the lines, so no request waits for
// their reader.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

namespace kdray::server {

enum class LogLevel : std::uint8_t { kInfo, kWarning, kError };

/// The names are those in the lines, and of --log-level.
std::string_view Name(LogLevel level);
/// nullopt if no level has this name.
std::optional<LogLevel> ParseLogLevel(std::string_view name);

/// A number, a flag, or a text of any bytes, which is escaped.
using LogValue = std::variant<std::string_view, double, std::uint64_t, bool>;
using LogField = std::pair<std::string_view, LogValue>;

/// The line without '\n': `time` (RFC 3339, UTC, milliseconds), `level`, `event`, then the fields
/// in their order.
std::string FormatLogLine(LogLevel level, std::string_view event,
                          std::initializer_list<LogField> fields);

/// Writes lines. Safe from many threads at once. Lines arrive whole and in order. If the reader
/// does not take them, at most kMaxLines and kMaxBytes wait. Further lines are dropped and counted;
/// a line `log_dropped` in their place has the count.
class Log {
 public:
  static constexpr std::size_t kMaxLines = 4096;
  static constexpr std::size_t kMaxBytes = std::size_t{2} << 20;

  /// Writes lines of `least` and above. The file descriptor must outlive the log; -1 drops
  /// everything. Throws std::system_error if no thread can be started.
  explicit Log(int fd, LogLevel least = LogLevel::kInfo);
  /// Writes the waiting lines, for a short time.
  ~Log();
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  /// Whether lines of this level are written.
  bool Takes(LogLevel level) const { return impl_ != nullptr && level >= least_; }
  /// Does not wait for the reader.
  void Write(LogLevel level, std::string_view event,
             std::initializer_list<LogField> fields) const noexcept;
  /// The number of dropped lines.
  std::uint64_t dropped() const;

 private:
  class Impl;
  const LogLevel least_;
  const std::unique_ptr<Impl> impl_;
};

}  // namespace kdray::server
