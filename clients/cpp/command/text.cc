// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/text.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>

namespace kdray::client {
namespace {

// Characters of UTF-8, not bytes: names of files and groups need not be ASCII.
std::size_t CharactersIn(std::string_view text) {
  return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  }));
}

std::ptrdiff_t Signed(std::size_t index) { return static_cast<std::ptrdiff_t>(index); }

std::string Formatted(const char* format, int digits, double number) {
  std::array<char, 400> text;  // "%.1f" of the largest double has 311 characters
  const int length = std::snprintf(text.data(), text.size(), format, digits, number);
  return {text.data(), static_cast<std::size_t>(length)};
}

std::vector<std::size_t> WidthsOf(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths(rows.empty() ? 0 : rows.front().size(), 0);
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < widths.size(); ++i) {
      widths[i] = std::max(widths[i], CharactersIn(row[i]));
    }
  }
  return widths;
}

}  // namespace

std::string CountText(std::uint64_t count) {
  std::string text = std::to_string(count);
  for (std::size_t i = text.size(); i > 3; i -= 3) text.insert(i - 3, ",");
  return text;
}

std::string CountedText(std::uint64_t count, std::string plural) {
  if (count == 1) plural.pop_back();
  return CountText(count) + " " + plural;
}

std::string ByteText(double bytes) {
  constexpr std::array kUnits = {"B", "KiB", "MiB", "GiB", "TiB"};
  std::size_t unit = 0;
  while (bytes >= 1000 && unit + 1 < kUnits.size()) {
    bytes /= 1024;
    ++unit;
  }
  return Formatted("%.*f", unit == 0 || bytes >= 100 ? 0 : 1, bytes) + " " + kUnits[unit];
}

std::string NumberText(double number, int digits) {
  const double size = std::abs(number);
  if (size >= 9999.5 && size < 1e15) {
    return (number < 0 ? "-" : "") + CountText(static_cast<std::uint64_t>(std::llround(size)));
  }
  return Formatted("%.*g", digits, number);
}

std::string DurationText(double milliseconds) {
  if (!(milliseconds >= 0)) return "?";
  if (milliseconds < 0.9995) return Formatted("%.*g", 2, milliseconds) + " ms";
  if (milliseconds < 999.5) return Formatted("%.*g", 3, milliseconds) + " ms";
  const double seconds = milliseconds / 1000;
  if (seconds < 9.995) return Formatted("%.*f", 2, seconds) + " s";
  if (seconds < 99.95) return Formatted("%.*f", 1, seconds) + " s";
  if (seconds > 1e9) return "more than 30 years";
  const auto whole = static_cast<std::uint64_t>(std::llround(seconds));
  const auto pair = [](std::uint64_t large, const char* unit, std::uint64_t small,
                       const char* small_unit) {
    return std::to_string(large) + " " + unit + " " + std::to_string(small) + " " + small_unit;
  };
  if (whole < 3600) return pair(whole / 60, "min", whole % 60, "s");
  const std::uint64_t minutes = (whole + 30) / 60;
  if (minutes < 48 * 60) return pair(minutes / 60, "h", minutes % 60, "min");
  return pair(minutes / 1440, "d", minutes % 1440 / 60, "h");
}

std::string ShortText(double number) {
  constexpr std::array kUnits = {"", " k", " M", " G", " T"};
  std::size_t unit = 0;
  while (number >= 999.5 && unit + 1 < kUnits.size()) {
    number /= 1000;
    ++unit;
  }
  if (unit == 0) return Formatted("%.*g", 3, number);
  const int decimals = number < 9.995 ? 2 : number < 99.95 ? 1 : 0;
  return Formatted("%.*f", decimals, number) + kUnits[unit];
}

std::string VectorText(const std::vector<double>& numbers) {
  std::string text;
  for (const double number : numbers) text += (text.empty() ? "" : " ") + NumberText(number, 6);
  return text;
}

std::string Table(const std::vector<std::vector<std::string>>& rows, std::string_view alignment) {
  std::string out;
  const std::vector<std::size_t> widths = WidthsOf(rows);
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < widths.size(); ++i) {
      const std::string padding(widths[i] - CharactersIn(row[i]), ' ');
      const bool flush_right = i < alignment.size() && alignment[i] == 'r';
      line += flush_right ? padding + row[i] : row[i] + padding;
      line += "  ";
    }
    line.erase(line.find_last_not_of(' ') + 1);
    out += line + "\n";
  }
  return out;
}

std::string FittedTable(const std::vector<std::vector<std::string>>& rows,
                        std::string_view alignment, std::size_t width, std::size_t keys) {
  const std::vector<std::size_t> widths = WidthsOf(rows);
  std::size_t total = 0;
  for (const std::size_t cell : widths) total += cell + 2;
  if (width == 0 || total <= width + 2) return Table(rows, alignment);

  std::string out;
  std::size_t next = std::min(keys, widths.size());
  std::size_t key_width = 0;
  for (std::size_t i = 0; i < next; ++i) key_width += widths[i] + 2;
  while (next < widths.size()) {
    // At least one column beside the keys, however narrow the terminal.
    std::size_t end = next, used = key_width;
    while (end < widths.size() && (end == next || used + widths[end] <= width)) {
      used += widths[end++] + 2;
    }
    std::vector<std::vector<std::string>> part;
    for (const auto& row : rows) {
      std::vector<std::string>& cells = part.emplace_back(row.begin(), row.begin() + Signed(keys));
      cells.insert(cells.end(), row.begin() + Signed(next), row.begin() + Signed(end));
    }
    std::string letters(alignment.substr(0, keys));
    letters += alignment.substr(next, end - next);
    out += (out.empty() ? "" : "\n") + Table(part, letters);
    next = end;
  }
  return out;
}

std::string Shortened(std::string_view text, std::size_t width) {
  std::size_t characters = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if ((static_cast<unsigned char>(text[i]) & 0xC0) == 0x80) continue;
    if (characters++ == width) return std::string(text.substr(0, i));
  }
  return std::string(text);
}

}  // namespace kdray::client
