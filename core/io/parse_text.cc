// SPDX-License-Identifier: Apache-2.0
#include "core/io/parse_text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <system_error>
#include <utility>

#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

// Bytes between two charges of the poll.
constexpr std::size_t kPiece = std::size_t{1} << 16;
// Bytes that memchr searches in one unit of work, rounded down.
constexpr std::size_t kSearchedBytes = 8;

std::string_view WithoutPlus(std::string_view word) {
  const bool has_plus = word.size() > 1 && word[0] == '+' && word[1] != '-' && word[1] != '+';
  return has_plus ? word.substr(1) : word;
}

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// For a decimal number that std::from_chars found out of range: whether it is too small, not too
// large. It is too small if its first nonzero digit comes after the decimal point.
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
  if (i < number.size()) {  // after the e
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

// std::from_chars, with 0 for a number that is too small and infinity for one that is too large.
std::optional<double> ReadDouble(std::string_view word) {
  if (word.size() > kLongestNumber) return std::nullopt;
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

std::string TooLong(std::string_view word) {
  return "a number of " + std::to_string(word.size()) + " characters; at most " +
         std::to_string(kLongestNumber) + " are allowed";
}

// Microsoft's older run-time library prints "1.#QNAN", "-1.#IND00", "1.#INF".
std::optional<double> ReadMicrosoftNonFinite(std::string_view word) {
  if (word.size() > kLongestNumber) return std::nullopt;
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

inline TextCursor::Kind TextCursor::KindOf(char c) {
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

TextCursor::TextCursor(std::string_view text, Syntax syntax, std::uint64_t first_line,
                       CancelPoll* poll)
    : text_(text),
      syntax_(syntax),
      poll_(poll),
      line_(first_line),
      next_lf_(Find('\n')),
      next_cr_(Find('\r')) {}

// The position of the next c, or the end of the text.
std::size_t TextCursor::Find(char c) {
  for (std::size_t begin = position_; begin < text_.size(); begin += kPiece) {
    const std::size_t found = text_.substr(begin, kPiece).find(c);
    if (Charge(std::min(found, kPiece) / kSearchedBytes)) break;
    if (found != std::string_view::npos) return begin + found;
  }
  return text_.size();
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

inline void TextCursor::PassAll(Kind kind) {
  const char* const text = text_.data();
  const std::size_t end = position_ + std::min(kPiece, text_.size() - position_);
  std::size_t i = position_;
  while (i < end && KindOf(text[i]) == kind) ++i;
  position_ = i;
  if (i == end && end < text_.size()) [[unlikely]]
    PassMore(kind);
}

void TextCursor::PassMore(Kind kind) {
  while (!AtEnd() && KindOf(text_[position_]) == kind) {
    if (position_ % kPiece == 0 && Charge(kPiece)) return;
    ++position_;
  }
}

void TextCursor::SkipBlanks() {
  for (;;) {
    PassAll(Kind::kBlank);
    if (!syntax_.continuation || AtEnd() || text_[position_] != '\\') return;
    if (Charge(8)) return;
    if (position_ + 1 < text_.size() && KindOf(text_[position_ + 1]) != Kind::kLineEnd) return;
    ++position_;
    PassLineEnd();
  }
}

std::string_view TextCursor::NextWord() {
  // A short word costs time too.
  if (Charge(16)) return {};
  SkipBlanks();
  if (AtEnd()) return {};
  if (syntax_.hash_comments && text_[position_] == '#') {
    position_ = LineEnd();
    return {};
  }
  const std::size_t begin = position_;
  PassAll(Kind::kWord);
  // A continuation may touch the word: the word ends there.
  const bool ends_line = AtEnd() || KindOf(text_[position_]) == Kind::kLineEnd;
  if (syntax_.continuation && ends_line && position_ > begin && text_[position_ - 1] == '\\') {
    --position_;
  }
  return text_.substr(begin, position_ - begin);
}

std::string_view TextCursor::BeforeHash(std::string_view word) {
  const std::size_t hash = word.find('#');
  if (hash == std::string_view::npos) return word;
  position_ = static_cast<std::size_t>(word.data() - text_.data()) + hash;
  return word.substr(0, hash);
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
  bool joins = syntax_.continuation && position_ > begin && text_[position_ - 1] == '\\';
  // A backslash in a comment is not there.
  if (joins && syntax_.hash_comments) joins = !HasComment(begin, position_);
  PassLineEnd();
  return !Charge(8) && joins && !AtEnd();
}

// Whether a comment begins between `begin`, which is at no word's middle, and the end of its line.
bool TextCursor::HasComment(std::size_t begin, std::size_t end) {
  for (std::size_t i = begin; i < end; ++i) {
    if ((i - begin) % kPiece == kPiece - 1 && Charge(kPiece)) return false;
    if (text_[i] == '#' && (i == begin || KindOf(text_[i - 1]) == Kind::kBlank)) return true;
  }
  return false;
}

TextCursor TextCursor::RestOfLine() {
  return TextCursor(text_.substr(position_, LineEnd() - position_), syntax_, line_, poll_);
}

bool TextCursor::FindLineWithWords() {
  for (;;) {
    SkipBlanks();
    if (Charge(8) || AtEnd()) return false;
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
  if (word.size() > kLongestNumber) return TooLong(word);
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
  if (word.size() > kLongestNumber) return std::nullopt;
  word = WithoutPlus(word);
  std::int64_t value = 0;
  const char* const end = word.data() + word.size();
  const auto [stopped, error] = std::from_chars(word.data(), end, value);
  if (stopped != end || error != std::errc()) return std::nullopt;
  return value;
}

std::string WhyNotInteger(std::string_view word) {
  if (word.empty()) return "an integer is missing";
  if (word.size() > kLongestNumber) return TooLong(word);
  return Quoted(word) + " is not an integer of 64 bits";
}

std::optional<std::int64_t> ParseCount(std::string_view word) {
  if (word.size() > kLongestNumber) return std::nullopt;
  const std::size_t point = word.find('.');
  if (point != std::string_view::npos && point > 0 &&
      word.find_first_not_of('0', point + 1) == std::string_view::npos) {
    word = word.substr(0, point);
  }
  return ParseInteger(word);
}

std::string_view WithoutPadding(std::string_view text, CancelPoll* poll) {
  std::size_t end = text.size();  // where the padding begins, as far as known
  for (std::size_t i = text.size(); i > 0; --i) {
    const char c = text[i - 1];
    const bool padding = c == '\0' || c == '\x1a';
    if (!padding && c != ' ' && c != '\t' && c != '\r' && c != '\n') break;
    if (padding) end = i - 1;
    if (i % kPiece == 0 && poll->Spend(kPiece)) break;
  }
  return text.substr(0, end);
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
