// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/progress_bar.h"

#include <algorithm>
#include <cmath>
#include <ostream>

#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

constexpr auto kFrame = std::chrono::milliseconds(100);
constexpr std::size_t kMostCells = 20, kFewestCells = 5;
constexpr const char* kEraseLine = "\r\x1b[K";
constexpr double kAlmost = 0.99;  // an estimate that has passed is not the end

// Whole seconds: "5 s", "2 min 5 s".
std::string SecondsText(double seconds) {
  return seconds < 60 ? std::to_string(static_cast<int>(seconds)) + " s"
                      : DurationText(seconds * 1000);
}

}  // namespace

ProgressBar::ProgressBar(Console& console, std::string label, double total, ProgressUnit unit,
                         bool quiet)
    : console_(console),
      label_(std::move(label)),
      total_(total),
      unit_(std::move(unit)),
      quiet_(quiet) {}

void ProgressBar::Start() {
  if (quiet_ || finished_ || thread_.joinable()) return;
  started_ = updated_ = Clock::now();
  thread_ = std::thread([this] {
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, kFrame, [this] { return finished_; })) Draw();
  });
}

void ProgressBar::Update(double done) {
  const std::lock_guard lock(mutex_);
  Start();
  if (!(done >= done_)) return;  // NaN too
  done_ = done;
  updated_ = Clock::now();
  if (!console_.err_is_terminal && thread_.joinable()) Draw();  // so the last tenth is not missed
}

void ProgressBar::Expect(std::optional<std::chrono::duration<double>> duration) {
  const std::lock_guard lock(mutex_);
  reports_ = false;
  if (duration) expected_s_ = duration->count();
  Start();
}

void ProgressBar::Finish() {
  {
    const std::lock_guard lock(mutex_);
    finished_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
  if (drawn_) console_.err << kEraseLine << std::flush;
  drawn_ = false;
}

double ProgressBar::Fraction() const {
  if (expected_s_ > 0) {
    const std::chrono::duration<double> elapsed = Clock::now() - started_;
    return std::min(elapsed.count() / expected_s_, kAlmost);
  }
  return reports_ && total_ > 0 ? std::min(done_ / total_, 1.0) : -1;
}

std::string ProgressBar::Line(double fraction, std::size_t width) const {
  const auto now = Clock::now();
  const double elapsed_s = std::chrono::duration<double>(now - started_).count();
  const auto amount = [this](double number) {
    if (unit_.bytes) return ByteText(number);
    return number < 1e6 ? CountText(static_cast<std::uint64_t>(number)) : ShortText(number);
  };
  std::string line = label_ + "  ";
  if (fraction >= 0) {
    line += std::to_string(static_cast<int>(fraction * 100)) + "%";
  }
  const double done = expected_s_ > 0 ? fraction * total_ : done_;
  if (!unit_.name.empty() && done > 0) {
    // The rate is that of the work reported, so it does not sink while a part is on its way.
    const double busy_s =
        expected_s_ > 0 ? elapsed_s : std::chrono::duration<double>(updated_ - started_).count();
    const std::string unit = unit_.bytes ? "" : " " + unit_.name;
    line += "  " + amount(done);
    if (total_ > 0) line += " of " + amount(total_);
    line += unit;
    if (busy_s > 0) {
      const double rate = done / busy_s;
      line += ", " + (unit_.bytes ? ByteText(rate) : ShortText(rate) + unit) + "/s";
    }
  }
  if (fraction > 0 && fraction < 1) {
    const double reported_s = std::chrono::duration<double>(updated_ - started_).count();
    const double total_s = expected_s_ > 0 ? expected_s_ : reported_s / fraction;
    const double left_s = std::max(total_s - elapsed_s, 0.0);
    line += std::string(expected_s_ > 0 ? ", about " : ", ") +
            SecondsText(std::max(std::ceil(left_s), 1.0)) + " left";
  } else if (fraction < 0) {
    line += (line.ends_with("  ") ? "" : ", ") + SecondsText(elapsed_s);
  }
  if (fraction < 0 || line.size() + kFewestCells + 3 > width) return line;
  const std::size_t cells = std::min(width - line.size() - 3, kMostCells);
  const auto filled = static_cast<std::size_t>(std::lround(fraction * static_cast<double>(cells)));
  return line.insert(label_.size() + 2,
                     "[" + std::string(filled, '#') + std::string(cells - filled, '.') + "] ");
}

void ProgressBar::Draw() {
  if (quiet_ || finished_) return;
  const auto elapsed = Clock::now() - started_;
  const double fraction = Fraction();
  if (console_.err_is_terminal) {
    if (elapsed < console_.patience / 3) return;
    const std::size_t width = console_.err_columns > 1 ? console_.err_columns - 1 : 79;
    console_.err << kEraseLine << Shortened(Line(fraction, width), width) << std::flush;
    drawn_ = true;
    return;
  }
  if (elapsed < console_.patience) return;
  const int tenth = static_cast<int>(std::max(fraction, 0.0) * 10);
  if (tenth <= last_tenth_) return;
  last_tenth_ = tenth;
  // Without the bar, which is for eyes that watch it move.
  console_.err << Line(fraction, 0) << std::endl;
}

}  // namespace kdray::client
