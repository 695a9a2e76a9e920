// The log: one JSON object a line, one write a line, so that lines of many threads do not mix.
#pragma once

#include <cstdint>
#include <initializer_list>
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

/// Where lines go. Safe from many threads at once; what cannot be written is dropped.
class Log {
 public:
  /// A file descriptor that outlives the log; -1 drops everything.
  explicit Log(int fd) : fd_(fd) {}
  void Write(LogLevel level, std::string_view event,
             std::initializer_list<LogField> fields) const noexcept;

 private:
  int fd_;
};

}  // namespace kdray::server
