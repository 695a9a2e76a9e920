#include "core/io/parse_text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
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

void TextCursor::NextLine() {
  SkipBlanks();
  const bool comment = syntax_.hash_comments && !AtEnd() && text_[position_] == '#';
  for (;;) {
    const std::size_t begin = position_;
    position_ = LineEnd();
    const bool joins =
        syntax_.continuation && !comment && position_ > begin && text_[position_ - 1] == '\\';
    PassLineEnd();
    if (!joins || AtEnd()) return;
  }
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
  word = WithoutPlus(word);
  double value = 0;
  const char* const end = word.data() + word.size();
  const auto [stopped, error] = std::from_chars(word.data(), end, value);
  if (stopped != end) return std::nullopt;
  if (error == std::errc::result_out_of_range) {
    if (!IsTooSmall(word)) return std::nullopt;
    return word[0] == '-' ? -0.0 : 0.0;
  }
  if (error != std::errc() || !std::isfinite(value)) return std::nullopt;
  return value;
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

std::string_view SkipByteOrderMark(std::string_view text) {
  constexpr std::string_view kMark = "\xef\xbb\xbf";
  return text.starts_with(kMark) ? text.substr(kMark.size()) : text;
}

bool EqualsIgnoringCase(std::string_view word, std::string_view keyword) {
  return std::equal(word.begin(), word.end(), keyword.begin(), keyword.end(),
                    [](char a, char b) { return (a >= 'A' && a <= 'Z' ? a - 'A' + 'a' : a) == b; });
}

}  // namespace kdray::core
