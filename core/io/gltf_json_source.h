// SPDX-License-Identifier: Apache-2.0
// The characters of a JSON text for a parser that copies every string and cannot be interrupted.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/cancel_poll.h"

namespace kdray::core {

/// Gives out a JSON text piece by piece. A string that begins with `data:` is replaced by "data:#N"
/// and kept as a view, number N of uris(). Another string beyond kLongestString becomes an empty
/// one. The text ends early when the poll stops, and at a number or word beyond kLongestString.
class JsonSource {
 public:
  static constexpr std::size_t kLongestString = std::size_t{1} << 16;

  JsonSource(std::string_view text, CancelPoll* poll) : text_(text), poll_(poll) { Refill(); }

  bool AtEnd() const { return at_ == piece_.size(); }
  char Current() const { return piece_[at_]; }
  void Next() {
    last_position_ = position();
    if (++at_ == piece_.size()) Refill();
  }
  /// Offset in the text of the current character, or of the string that it stands for.
  std::size_t position() const { return piece_is_text_ ? piece_begin_ + at_ : piece_begin_; }
  /// That of the character before it.
  std::size_t last_position() const { return last_position_; }
  /// The contents of the strings that were replaced, escapes included.
  const std::vector<std::string_view>& uris() const { return uris_; }

  /// For a parser that takes two iterators; the end is Iterator().
  class Iterator {
   public:
    using iterator_category = std::input_iterator_tag;
    using value_type = char;
    using difference_type = std::ptrdiff_t;
    using pointer = const char*;
    using reference = char;

    Iterator() = default;
    explicit Iterator(JsonSource* source) : source_(source) {}
    char operator*() const { return source_->Current(); }
    Iterator& operator++() {
      source_->Next();
      return *this;
    }
    Iterator operator++(int) {
      const Iterator old = *this;
      ++*this;
      return old;
    }
    friend bool operator==(const Iterator& a, const Iterator& b) { return a.Ended() == b.Ended(); }

   private:
    bool Ended() const { return source_ == nullptr || source_->AtEnd(); }
    JsonSource* source_ = nullptr;
  };

 private:
  void Refill();
  void End() { Give({}, false, text_.size()); }
  void Give(std::string_view piece, bool is_text, std::size_t begin) {
    piece_ = piece;
    piece_is_text_ = is_text;
    piece_begin_ = begin;
    at_ = 0;
  }

  std::string_view text_;
  CancelPoll* poll_;
  std::size_t next_ = 0;  // where the next piece begins
  std::string_view piece_;
  bool piece_is_text_ = false;
  std::size_t piece_begin_ = 0;
  std::size_t at_ = 0;
  std::size_t last_position_ = 0;
  std::string replacement_;
  std::vector<std::string_view> uris_;
};

}  // namespace kdray::core
