#include "clients/cpp/command/text.h"

#include <algorithm>
#include <array>
#include <cstdio>

namespace kdray::client {

std::string CountText(std::uint64_t count) {
  std::string text = std::to_string(count);
  for (std::size_t i = text.size(); i > 3; i -= 3) text.insert(i - 3, ",");
  return text;
}

std::string ByteText(double bytes) {
  constexpr std::array kUnits = {"B", "KiB", "MiB", "GiB", "TiB"};
  std::size_t unit = 0;
  while (bytes >= 1000 && unit + 1 < kUnits.size()) {
    bytes /= 1024;
    ++unit;
  }
  std::array<char, 32> text;
  const int length =
      std::snprintf(text.data(), text.size(), unit == 0 || bytes >= 100 ? "%.0f" : "%.1f", bytes);
  return std::string(text.data(), static_cast<std::size_t>(length)) + " " + kUnits[unit];
}

std::string NumberText(double number, int digits) {
  std::array<char, 40> text;
  const int length = std::snprintf(text.data(), text.size(), "%.*g", digits, number);
  return {text.data(), static_cast<std::size_t>(length)};
}

std::string VectorText(const std::vector<double>& numbers) {
  std::string text;
  for (const double number : numbers) text += (text.empty() ? "" : " ") + NumberText(number, 6);
  return text;
}

std::string Table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment) {
  std::string out;
  if (rows.empty()) return out;
  std::vector<std::size_t> widths(rows.front().size(), 0);
  for (const auto& row : rows)
    for (std::size_t i = 0; i < widths.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < widths.size(); ++i) {
      const std::string padding(widths[i] - row[i].size(), ' ');
      const bool flush_right = i < alignment.size() && alignment[i] == 'r';
      line += flush_right ? padding + row[i] : row[i] + padding;
      line += "  ";
    }
    line.erase(line.find_last_not_of(' ') + 1);
    out += line + "\n";
  }
  return out;
}

}  // namespace kdray::client
