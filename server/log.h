// The log: one JSON object a line. Lines are written by a thread of their own, so that no request
// ever waits for whoever reads them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

namespace kdray::server {

enum class LogLevel : std::uint8_t { kInfo, kWarning, kError };

/// A number, a flag, or a text of any bytes: escaped here.
using LogValue = std::variant<std::string_view, double, std::uint64_t, bool>;
using LogField = std::pair<std::string_view, LogValue>;

/// The line without its end: `time` (RFC 3339, UTC, milliseconds), `level`, `event`, then the
/// fields in their order.
std::string FormatLogLine(LogLevel level, std::string_view event,
                          std::initializer_list<LogField> fields);

/// Where lines go. Safe from many threads at once. Lines arrive whole and in order. While nobody
/// takes them, kMaxLines and kMaxBytes of them wait; what comes then is dropped and counted, and a
/// line `log_dropped` tells how many stood in its place.
class Log {
 public:
  static constexpr std::size_t kMaxLines = 4096;
  static constexpr std::size_t kMaxBytes = std::size_t{2} << 20;

  /// A file descriptor that outlives the log; -1 drops everything. Throws std::system_error when
  /// there is no thread to be had.
  explicit Log(int fd);
  /// Writes what waits, and gives up soon when nobody takes it.
  ~Log();
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  /// Never waits for a reader.
  void Write(LogLevel level, std::string_view event,
             std::initializer_list<LogField> fields) const noexcept;
  /// Lines that were never written.
  std::uint64_t dropped() const;

 private:
  class Impl;
  const std::unique_ptr<Impl> impl_;
};

}  // namespace kdray::server
