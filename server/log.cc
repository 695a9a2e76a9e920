#include "server/log.h"

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>

namespace kdray::server {
namespace {

std::string TimeNow() {
  using namespace std::chrono;
  const auto now = system_clock::now();
  const std::time_t seconds_now = system_clock::to_time_t(now);
  const auto ms = duration_cast<milliseconds>(now.time_since_epoch()).count() % 1000;
  std::tm utc{};
  gmtime_r(&seconds_now, &utc);
  char text[80];
  std::snprintf(text, sizeof(text), "%04d-%02d-%02dT%02d:%02d:%02d.%03dZ", utc.tm_year + 1900,
                utc.tm_mon + 1, utc.tm_mday, utc.tm_hour, utc.tm_min, utc.tm_sec,
                static_cast<int>(ms));
  return text;
}

/// Printable ASCII as it is, every other byte as \u00NN: a log must stay readable and one line
/// whatever a client sends.
void AppendQuoted(std::string& out, std::string_view text) {
  out += '"';
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (byte < 0x20 || byte >= 0x7f) {
      char escaped[8];
      std::snprintf(escaped, sizeof(escaped), "\\u%04x", byte);
      out += escaped;
    } else {
      out += c;
    }
  }
  out += '"';
}

struct AppendValue {
  std::string& out;
  void operator()(std::string_view text) const { AppendQuoted(out, text); }
  void operator()(double number) const {
    char text[40];
    std::snprintf(text, sizeof(text), "%.3f", number);
    out += std::isfinite(number) ? text : "null";
  }
  void operator()(std::uint64_t number) const { out += std::to_string(number); }
  void operator()(bool flag) const { out += flag ? "true" : "false"; }
};

std::string_view Name(LogLevel level) {
  switch (level) {
    case LogLevel::kInfo:
      return "info";
    case LogLevel::kWarning:
      return "warning";
    case LogLevel::kError:
      break;
  }
  return "error";
}

}  // namespace

std::string FormatLogLine(LogLevel level, std::string_view event,
                          std::initializer_list<LogField> fields) {
  std::string line = "{\"time\":\"" + TimeNow() + "\",\"level\":\"";
  line += Name(level);
  line += "\",\"event\":";
  AppendQuoted(line, event);
  for (const auto& [name, value] : fields) {
    const auto* text = std::get_if<std::string_view>(&value);
    if (text != nullptr && text->empty()) continue;
    line += ',';
    AppendQuoted(line, name);
    line += ':';
    std::visit(AppendValue{line}, value);
  }
  line += '}';
  return line;
}

void Log::Write(LogLevel level, std::string_view event,
                std::initializer_list<LogField> fields) const noexcept {
  if (fd_ < 0) return;
  try {
    const std::string line = FormatLogLine(level, event, fields) + "\n";
    [[maybe_unused]] const ssize_t written = write(fd_, line.data(), line.size());
  } catch (...) {
    // No memory for a line: the line is lost.
  }
}

}  // namespace kdray::server
