#include "clients/cpp/command/progress_bar.h"

#include <algorithm>
#include <cmath>
#include <ostream>

#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

constexpr auto kQuickEnough = std::chrono::milliseconds(330);
constexpr auto kFrame = std::chrono::milliseconds(80);
constexpr int kCells = 30;
constexpr const char* kEraseLine = "\r\x1b[K";

}  // namespace

ProgressBar::ProgressBar(Console& console, std::string label, std::uint64_t total_bytes, bool quiet)
    : console_(console), label_(std::move(label)), total_bytes_(total_bytes), quiet_(quiet) {}

void ProgressBar::Update(double fraction) {
  if (quiet_) return;
  fraction = fraction >= 0 ? std::min(fraction, 1.0) : 0;  // NaN becomes 0 too
  if (!console_.err_is_terminal) {
    const int tenth = static_cast<int>(fraction * 10);
    if (tenth <= last_tenth_) return;
    last_tenth_ = tenth;
    console_.err << label_ << " " << tenth * 10 << "%" << std::endl;
    return;
  }
  const auto now = Clock::now();
  if (now - started_ < kQuickEnough || now - last_drawn_ < kFrame) return;
  last_drawn_ = now;
  Draw(fraction, now);
}

void ProgressBar::Draw(double fraction, Clock::time_point now) {
  const int filled = static_cast<int>(std::lround(fraction * kCells));
  std::string line = label_ + "  [" + std::string(filled, '#') + std::string(kCells - filled, '.') +
                     "] " + std::to_string(static_cast<int>(fraction * 100)) + "%";
  if (total_bytes_ > 0) {
    const double seconds = std::chrono::duration<double>(now - started_).count();
    const double sent = fraction * static_cast<double>(total_bytes_);
    line += "  " + ByteText(sent) + " of " + ByteText(static_cast<double>(total_bytes_)) + ", " +
            ByteText(sent / seconds) + "/s";
  }
  console_.err << kEraseLine << line << std::flush;
  drawn_ = true;
}

void ProgressBar::Finish() {
  if (drawn_) console_.err << kEraseLine << std::flush;
  drawn_ = false;
}

}  // namespace kdray::client
