// Words and numbers of text mesh files, in one pass and without copies.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "core/base/cancel_poll.h"

namespace kdray::core {

/// Walks through a text by words and lines. A line ends with LF, CR LF or CR; words are separated
/// by blanks and tabs. O(text) for a whole walk, whatever mix of calls.
class TextCursor {
 public:
  /// What else a format's lines may hold.
  struct Syntax {
    bool hash_comments = false;  ///< a word that starts with # and all behind it is not there
    bool continuation = false;   ///< a backslash at the end of a line joins the next line to it
  };

  /// `first_line`: the number of the text's first line in its file. `poll` is charged for what is
  /// passed, by this cursor and by its copies, and outlives them. Once it has stopped, the cursor
  /// is at the end of its text: loops end, and what they found means nothing.
  TextCursor(std::string_view text, Syntax syntax, std::uint64_t first_line = 1,
             CancelPoll* poll = nullptr);

  /// The next word of this line; empty at its end.
  std::string_view NextWord();
  /// The next word of this line or of a later one; empty at the end of the text.
  std::string_view NextWordOnAnyLine();
  /// To the beginning of the next line.
  void NextLine();
  /// The same, but a line that a backslash joins to this one counts as the next. Returns whether
  /// there is such a line.
  bool NextPhysicalLine();
  /// To the first line, this one or a later one, that has a word after the cursor. False when there
  /// is none.
  bool FindLineWithWords();

  bool AtEnd() const { return position_ >= text_.size(); }
  /// The character at the cursor, which is not at the end.
  char Peek() const { return text_[position_]; }
  std::size_t remaining() const { return text_.size() - position_; }
  /// Number of the line that the next word is on, or, after the last word, was on.
  std::uint64_t line() const { return line_; }

 private:
  enum class Kind : std::uint8_t { kWord, kBlank, kLineEnd };
  static Kind KindOf(char c);

  // Counts that work. Once it is time to stop, returns true, and the cursor is at the end.
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
  // To the first character of another kind.
  void PassAll(Kind kind);
  void PassMore(Kind kind);
  void SkipBlanks();

  std::string_view text_;
  Syntax syntax_;
  CancelPoll* poll_;
  std::size_t position_ = 0;
  std::uint64_t line_;
  // The LF and the CR that follow, or followed when last looked for. Kept, so that a file with CR
  // only is not searched for an LF once a line.
  std::size_t next_lf_;
  std::size_t next_cr_;
};

/// A longer word is not a number: reading it could not be interrupted.
inline constexpr std::size_t kLongestNumber = std::size_t{1} << 16;

/// A whole word as a finite decimal number, rounded to the nearest double; too small a number
/// becomes 0. Nothing for anything else: an empty or half-read word, "nan", "inf", hexadecimal, a
/// decimal comma, a number beyond the range of double. A leading + is allowed. WhyNotNumber says
/// which.
std::optional<double> ParseNumber(std::string_view word);
std::string WhyNotNumber(std::string_view word);

/// A whole word as a coordinate: what ParseNumber takes, and also what programs print for numbers
/// that are not finite ("nan", "-inf", "1.#QNAN") and numbers beyond the range of double, which
/// become infinite. A mesh may have such coordinates in vertices that no face uses.
std::optional<double> ParseCoordinate(std::string_view word);

/// A whole word as a decimal integer of 64 bits; a leading + is allowed. WhyNotInteger says what is
/// wrong with another word.
std::optional<std::int64_t> ParseInteger(std::string_view word);
std::string WhyNotInteger(std::string_view word);

/// A whole word as a number of things: an integer, also written as a fraction ("8.0").
std::optional<std::int64_t> ParseCount(std::string_view word);

/// The text without what pads a file at its end: NUL bytes, and the Ctrl-Z that ends a text in DOS.
/// Any part of the text when the poll has stopped.
std::string_view WithoutPadding(std::string_view text, CancelPoll* poll);

/// The text without a UTF-8 byte order mark in front.
std::string_view SkipByteOrderMark(std::string_view text);

/// True when the word is this keyword (begins with it), written in any case; `keyword` in lower
/// case.
bool EqualsIgnoringCase(std::string_view word, std::string_view keyword);
bool StartsIgnoringCase(std::string_view word, std::string_view keyword);

}  // namespace kdray::core
