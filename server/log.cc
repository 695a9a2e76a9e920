// SPDX-License-Identifier: Apache-2.0
#include "server/log.h"

#include <spdlog/async_logger.h>
#include <spdlog/details/thread_pool.h>
#include <spdlog/sinks/sink.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <deque>
#include <mutex>
#include <thread>

#include "core/base/hex.h"
#include "server/http/time_text.h"
#include "server/line_sink.h"

namespace kdray::server {
namespace {

/// How long the thread sleeps after it has written all lines.
constexpr std::chrono::milliseconds kGatherTime{3};

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
      out += "\\u00";
      core::AppendHex(byte, &out);
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

}  // namespace

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

std::optional<LogLevel> ParseLogLevel(std::string_view name) {
  for (const LogLevel level : {LogLevel::kInfo, LogLevel::kWarning, LogLevel::kError}) {
    if (Name(level) == name) return level;
  }
  return std::nullopt;
}

std::string FormatLogLine(LogLevel level, std::string_view event,
                          std::initializer_list<LogField> fields) {
  std::string line = "{\"time\":\"" + Rfc3339(UnixMsNow()) + "\",\"level\":\"";
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

/// The queue and the thread are spdlog's. spdlog has two ways with a full queue: the request waits,
/// or the oldest line is dropped without a word, and neither counts bytes. So its queue never
/// fills: lines beyond the limits are refused here.
class Log::Impl {
 public:
  explicit Impl(int fd)
      : sink_(std::make_shared<Sink>(*this, fd)),
        // One place beyond the limit is for a report, one for spdlog's own end.
        pool_(std::make_shared<spdlog::details::thread_pool>(kMaxLines + 2, 1)),
        logger_(std::make_shared<spdlog::async_logger>(
            "", sink_, pool_, spdlog::async_overflow_policy::overrun_oldest)) {
    // spdlog reports there what it catches, by default on standard error.
    logger_->set_error_handler([](const std::string&) { has_failed = true; });
  }
  ~Impl() {
    {
      const std::lock_guard lock(mutex_);
      if (HasRoom()) TellDropped();
    }
    sink_->lines.Stop();
    pool_.reset();  // waits for its thread
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void Write(const std::string& line) {
    const std::lock_guard lock(mutex_);
    if (HasRoom()) {
      TellDropped();
      if (Enqueue(line, kLine)) return;
    }
    Drop();
  }
  void Lose() {
    const std::lock_guard lock(mutex_);
    Drop();
  }
  std::uint64_t dropped() const {
    const std::lock_guard lock(mutex_);
    return dropped_;
  }

 private:
  // How the sink tells them apart; the lines hold their levels themselves.
  static constexpr auto kLine = spdlog::level::info, kReport = spdlog::level::warn;

  struct Sink final : spdlog::sinks::sink {
    Sink(Impl& log_impl, int fd) : owner(log_impl), lines(fd) {}
    void log(const spdlog::details::log_msg& message) override {
      const std::string_view line(message.payload.data(), message.payload.size());
      const bool is_last = owner.Ended(message.level, line.size(), lines.Write(line));
      // Further lines gather meanwhile. They would wake this thread one by one, which delays the
      // requests that write them.
      if (is_last) std::this_thread::sleep_for(kGatherTime);
    }
    void flush() override {}
    void set_pattern(const std::string&) override {}
    void set_formatter(std::unique_ptr<spdlog::formatter>) override {}

    Impl& owner;
    LineSink lines;
  };

  /// Whether no other line waits.
  bool Ended(spdlog::level::level_enum kind, std::size_t bytes, bool is_written) {
    const std::lock_guard lock(mutex_);
    --lines_;
    bytes_ -= bytes;
    if (kind == kReport) {
      if (!is_written) untold_ += reports_.front();
      reports_.pop_front();
    } else if (!is_written) {
      Drop();
    }
    return lines_ == 0;
  }

  // With mutex_ held:
  bool HasRoom() const { return lines_ < kMaxLines && bytes_ < kMaxBytes; }
  void Drop() {
    ++dropped_;
    ++untold_;
  }
  void TellDropped() {
    if (untold_ == 0) return;
    reports_.push_back(untold_);
    const std::string line =
        FormatLogLine(LogLevel::kWarning, "log_dropped", {{"lines", untold_}}) + "\n";
    if (Enqueue(line, kReport)) {
      untold_ = 0;
    } else {
      reports_.pop_back();
    }
  }
  /// False when there is no memory.
  bool Enqueue(const std::string& line, spdlog::level::level_enum kind) {
    has_failed = false;
    logger_->log(kind, spdlog::string_view_t(line.data(), line.size()));
    if (has_failed) return false;
    ++lines_;
    bytes_ += line.size();
    return true;
  }

  static thread_local bool has_failed;  ///< whether spdlog could not take this thread's line

  mutable std::mutex mutex_;
  std::size_t lines_ = 0, bytes_ = 0;  ///< that wait
  std::uint64_t dropped_ = 0, untold_ = 0;
  std::deque<std::uint64_t> reports_;  ///< the numbers of those that wait
  const std::shared_ptr<Sink> sink_;
  std::shared_ptr<spdlog::details::thread_pool> pool_;
  const std::shared_ptr<spdlog::async_logger> logger_;
};

thread_local bool Log::Impl::has_failed = false;

Log::Log(int fd, LogLevel least)
    : least_(least), impl_(fd < 0 ? nullptr : std::make_unique<Impl>(fd)) {}
Log::~Log() = default;

void Log::Write(LogLevel level, std::string_view event,
                std::initializer_list<LogField> fields) const noexcept {
  if (!Takes(level)) return;
  try {
    impl_->Write(FormatLogLine(level, event, fields) + "\n");
  } catch (...) {
    impl_->Lose();  // no memory for the line
  }
}

std::uint64_t Log::dropped() const { return impl_ == nullptr ? 0 : impl_->dropped(); }

}  // namespace kdray::server
