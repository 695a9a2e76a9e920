// SPDX-License-Identifier: Apache-2.0
// Reads words and numbers of text mesh files, in one pass and without copies.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "core/base/cancel_poll.h"

namespace kdray::core {

/// Walks through a text by words and lines. A line ends with LF, CR LF or CR; words are separated
/// by blanks and tabs. O(text) for a whole walk, with any mix of calls.
class TextCursor {
 public:
  /// Syntax of lines that depends on the format.
  struct Syntax {
    bool hash_comments =
        false;                  ///< a word that starts with #, and the rest of its line, is skipped
    bool continuation = false;  ///< a backslash at the end of a line joins the next line to it
  };

  /// `first_line`: the number of the text's first line in its file. This cursor and its copies
  /// charge `poll` for the text that they pass; it must outlive them. When it has stopped, the
  /// cursor is at the end of its text, so loops end; their results are then unspecified.
  TextCursor(std::string_view text, Syntax syntax, std::uint64_t first_line = 1,
             CancelPoll* poll = nullptr);

  /// The next word of this line; empty at its end.
  std::string_view NextWord();
  /// The part of a word, which NextWord() has just returned, before a # in it; the rest of its line
  /// is then a comment. For numbers, in which a # cannot be; a name may have one.
  std::string_view BeforeHash(std::string_view word);
  /// The next word of this line or of a later one; empty at the end of the text.
  std::string_view NextWordOnAnyLine();
  /// Moves to the beginning of the next line.
  void NextLine();
  /// The same, but a line that a backslash joins to this one counts as the next. Returns whether
  /// there is a next line.
  bool NextPhysicalLine();
  /// Moves to the first line, this one or a later one, that has a word after the cursor. False at
  /// the end of the text.
  bool FindLineWithWords();

  /// The rest of this line alone, without the lines that a backslash joins to it.
  TextCursor RestOfLine();

  bool AtEnd() const { return position_ >= text_.size(); }
  /// The character at the cursor, which must not be at the end.
  char Peek() const { return text_[position_]; }
  std::size_t remaining() const { return text_.size() - position_; }
  /// Number of the line that the next word is on, or, after the last word, was on.
  std::uint64_t line() const { return line_; }

 private:
  enum class Kind : std::uint8_t { kWord, kBlank, kLineEnd };
  static Kind KindOf(char c);

  // Charges the work. If the poll has stopped, returns true and moves the cursor to the end.
  bool Charge(std::uint64_t work) {
    if (poll_ == nullptr || !poll_->Spend(work)) [[likely]] {
      return false;
    }
    position_ = text_.size();
    return true;
  }
  std::size_t Find(char c);
  std::size_t LineEnd();
  void PassLineEnd();
  bool HasComment(std::size_t begin, std::size_t end);
  // Moves to the first character of another kind.
  void PassAll(Kind kind);
  void PassMore(Kind kind);
  void SkipBlanks();

  std::string_view text_;
  Syntax syntax_;
  CancelPoll* poll_;
  std::size_t position_ = 0;
  std::uint64_t line_;
  // The next LF and the next CR, as last searched. Kept, so a file with CR only is not searched for
  // an LF on every line.
  std::size_t next_lf_;
  std::size_t next_cr_;
};

/// A longer word is not read as a number, because reading could not be cancelled.
inline constexpr std::size_t kLongestNumber = std::size_t{1} << 16;

/// A whole word as a finite decimal number, rounded to the nearest double; a number that is too
/// small becomes 0. A leading + is allowed. nullopt for an empty word, a word that is only partly a
/// number, "nan", "inf", hexadecimal, a decimal comma, or a number beyond the range of double.
/// WhyNotNumber says which.
std::optional<double> ParseNumber(std::string_view word);
std::string WhyNotNumber(std::string_view word);

/// A whole word as a coordinate. Accepts ParseNumber's input, the text that programs print for
/// numbers that are not finite ("nan", "-inf", "1.#QNAN"), and numbers beyond the range of double,
/// which become infinite. A mesh may have such coordinates in vertices that no face uses.
std::optional<double> ParseCoordinate(std::string_view word);

/// A whole word as a decimal integer of 64 bits; a leading + is allowed. WhyNotInteger says why
/// another word is invalid.
std::optional<std::int64_t> ParseInteger(std::string_view word);
std::string WhyNotInteger(std::string_view word);

/// A whole word as a count: an integer, which may be written as a fraction ("8.0").
std::optional<std::int64_t> ParseCount(std::string_view word);

/// The text without padding at its end: NUL bytes, and the Ctrl-Z that ends a text in DOS. When the
/// poll has stopped, the result is any part of the text.
std::string_view WithoutPadding(std::string_view text, CancelPoll* poll);

/// The text without a UTF-8 byte order mark in front.
std::string_view SkipByteOrderMark(std::string_view text);

/// True when the word is this keyword (begins with it) in any case; `keyword` must be lower case.
bool EqualsIgnoringCase(std::string_view word, std::string_view keyword);
bool StartsIgnoringCase(std::string_view word, std::string_view keyword);

}  // namespace kdray::core
