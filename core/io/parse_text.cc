#include "core/io/parse_text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <system_error>

#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

enum class Kind : std::uint8_t { kWord, kBlank, kLineEnd };

Kind KindOf(char c) {
  static constexpr std::array<Kind, 256> kKinds = [] {
    std::array<Kind, 256> kinds{};
    for (const char blank : {' ', '\t', '\v', '\f'}) {
      kinds[static_cast<unsigned char>(blank)] = Kind::kBlank;
    }
    kinds['\n'] = Kind::kLineEnd;
    kinds['\r'] = Kind::kLineEnd;
    return kinds;
  }();
  return kKinds[static_cast<unsigned char>(c)];
}

std::string_view WithoutPlus(std::string_view word) {
  const bool has_plus = word.size() > 1 && word[0] == '+' && word[1] != '-' && word[1] != '+';
  return has_plus ? word.substr(1) : word;
}

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// For a decimal number that std::from_chars found out of range: whether it is too small, not too
// large. It is too small when its first digit that is not 0 stands behind the decimal point.
bool IsTooSmall(std::string_view number) {
  std::int64_t place = 0;  // power of ten of the first such digit
  bool point = false;
  bool found = false;
  std::size_t i = number[0] == '-' ? 1 : 0;
  for (; i < number.size() && (IsDigit(number[i]) || number[i] == '.'); ++i) {
    if (number[i] == '.') {
      point = true;
    } else if (!found) {
      found = number[i] != '0';
      if (point) --place;
    } else if (!point) {
      ++place;
    }
  }
  if (i < number.size()) {  // behind the e
    ++i;
    const bool negative = i < number.size() && number[i] == '-';
    if (i < number.size() && !IsDigit(number[i])) ++i;
    std::int64_t exponent = 0;
    for (; i < number.size() && IsDigit(number[i]); ++i) {
      exponent = std::min<std::int64_t>(exponent * 10 + (number[i] - '0'), std::int64_t{1} << 50);
    }
    place += negative ? -exponent : exponent;
  }
  return place < 0;
}

// What std::from_chars reads, with a number that is too small as 0 and one that is too large as
// infinity.
std::optional<double> ReadDouble(std::string_view word) {
  word = WithoutPlus(word);
  double value = 0;
  const char* const end = word.data() + word.size();
  const auto [stopped, error] = std::from_chars(word.data(), end, value);
  if (stopped != end || error == std::errc::invalid_argument) return std::nullopt;
  if (error == std::errc::result_out_of_range) {
    value = IsTooSmall(word) ? 0.0 : std::numeric_limits<double>::infinity();
    return word[0] == '-' ? -value : value;
  }
  return value;
}

// Microsoft's older run-time library prints "1.#QNAN", "-1.#IND00", "1.#INF".
std::optional<double> ReadMicrosoftNonFinite(std::string_view word) {
  const bool negative = word.starts_with('-');
  if (negative || word.starts_with('+')) word.remove_prefix(1);
  if (!word.starts_with("1.#")) return std::nullopt;
  word.remove_prefix(3);
  while (word.ends_with('0')) word.remove_suffix(1);
  if (word == "INF") {
    const double infinity = std::numeric_limits<double>::infinity();
    return negative ? -infinity : infinity;
  }
  if (word != "IND" && word != "QNAN" && word != "SNAN") return std::nullopt;
  return std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

TextCursor::TextCursor(std::string_view text, Syntax syntax, std::uint64_t first_line)
    : text_(text), syntax_(syntax), line_(first_line), next_lf_(Find('\n')), next_cr_(Find('\r')) {}

// The position of the next c, or the end of the text.
std::size_t TextCursor::Find(char c) const {
  return std::min(text_.find(c, position_), text_.size());
}

std::size_t TextCursor::LineEnd() {
  if (next_lf_ < position_) next_lf_ = Find('\n');
  if (next_cr_ < position_) next_cr_ = Find('\r');
  return std::min(next_lf_, next_cr_);
}

void TextCursor::PassLineEnd() {
  if (AtEnd()) return;
  const bool is_crlf = text_.substr(position_, 2) == "\r\n";
  position_ += is_crlf ? 2 : 1;
  ++line_;
}

void TextCursor::SkipBlanks() {
  for (;;) {
    while (!AtEnd() && KindOf(text_[position_]) == Kind::kBlank) ++position_;
    if (!syntax_.continuation || AtEnd() || text_[position_] != '\\') return;
    if (position_ + 1 < text_.size() && KindOf(text_[position_ + 1]) != Kind::kLineEnd) return;
    ++position_;
    PassLineEnd();
  }
}

std::string_view TextCursor::NextWord() {
  SkipBlanks();
  if (AtEnd()) return {};
  if (syntax_.hash_comments && text_[position_] == '#') {
    position_ = LineEnd();
    return {};
  }
  const std::size_t begin = position_;
  while (!AtEnd() && KindOf(text_[position_]) == Kind::kWord) ++position_;
  // A continuation may touch the word: the word ends there.
  const bool ends_line = AtEnd() || KindOf(text_[position_]) == Kind::kLineEnd;
  if (syntax_.continuation && ends_line && position_ > begin && text_[position_ - 1] == '\\') {
    --position_;
  }
  return text_.substr(begin, position_ - begin);
}

std::string_view TextCursor::NextWordOnAnyLine() {
  for (;;) {
    const std::string_view word = NextWord();
    if (!word.empty() || AtEnd()) return word;
    NextLine();
  }
}

void TextCursor::NextLine() {
  while (NextPhysicalLine()) {
  }
}

bool TextCursor::NextPhysicalLine() {
  const std::size_t begin = position_;
  position_ = LineEnd();
  std::size_t first = begin;
  while (first < position_ && KindOf(text_[first]) == Kind::kBlank) ++first;
  const bool comment = syntax_.hash_comments && first < position_ && text_[first] == '#';
  const bool joins =
      syntax_.continuation && !comment && position_ > begin && text_[position_ - 1] == '\\';
  PassLineEnd();
  return joins && !AtEnd();
}

bool TextCursor::FindLineWithWords() {
  for (;;) {
    SkipBlanks();
    if (AtEnd()) return false;
    const bool comment = syntax_.hash_comments && text_[position_] == '#';
    if (!comment && KindOf(text_[position_]) == Kind::kWord) return true;
    position_ = LineEnd();
    PassLineEnd();
  }
}

std::optional<double> ParseNumber(std::string_view word) {
  const std::optional<double> value = ReadDouble(word);
  return value && std::isfinite(*value) ? value : std::nullopt;
}

std::optional<double> ParseCoordinate(std::string_view word) {
  if (const std::optional<double> value = ReadDouble(word)) return value;
  return ReadMicrosoftNonFinite(word);
}

std::string WhyNotNumber(std::string_view word) {
  if (word.empty()) return "a number is missing";
  const std::string_view number = WithoutPlus(word);
  double value = 0;
  const char* const end = number.data() + number.size();
  const auto [stopped, error] = std::from_chars(number.data(), end, value);
  if (stopped == end && error == std::errc()) return Quoted(word) + " is not a finite number";
  if (stopped == end && error == std::errc::result_out_of_range) {
    return Quoted(word) + " is beyond the range of double";
  }
  return Quoted(word) + " is not a number";
}

std::optional<std::int64_t> ParseInteger(std::string_view word) {
  word = WithoutPlus(word);
  std::int64_t value = 0;
  const char* const end = word.data() + word.size();
  const auto [stopped, error] = std::from_chars(word.data(), end, value);
  if (stopped != end || error != std::errc()) return std::nullopt;
  return value;
}

std::string WhyNotInteger(std::string_view word) {
  if (word.empty()) return "an integer is missing";
  return Quoted(word) + " is not an integer of 64 bits";
}

std::optional<std::int64_t> ParseCount(std::string_view word) {
  const std::size_t point = word.find('.');
  if (point != std::string_view::npos && point > 0 &&
      word.find_first_not_of('0', point + 1) == std::string_view::npos) {
    word = word.substr(0, point);
  }
  return ParseInteger(word);
}

std::string_view WithoutPadding(std::string_view text) {
  constexpr std::string_view kBlanksAndPadding("\0\x1a \t\r\n", 6);
  constexpr std::string_view kPadding("\0\x1a", 2);
  const std::size_t last = text.find_last_not_of(kBlanksAndPadding);
  const std::size_t padding = text.find_first_of(kPadding, last == text.npos ? 0 : last + 1);
  return text.substr(0, padding);
}

std::string_view SkipByteOrderMark(std::string_view text) {
  constexpr std::string_view kMark = "\xef\xbb\xbf";
  return text.starts_with(kMark) ? text.substr(kMark.size()) : text;
}

bool EqualsIgnoringCase(std::string_view word, std::string_view keyword) {
  return std::equal(word.begin(), word.end(), keyword.begin(), keyword.end(),
                    [](char a, char b) { return (a >= 'A' && a <= 'Z' ? a - 'A' + 'a' : a) == b; });
}

bool StartsIgnoringCase(std::string_view word, std::string_view keyword) {
  return EqualsIgnoringCase(word.substr(0, keyword.size()), keyword);
}

}  // namespace kdray::core
