// SPDX-License-Identifier: Apache-2.0
// The position of a JSON parser in its text, and errors with that position. Shared by the two
// readers (api/json_batch.cc, api/json_reader.cc), whose SAX parser does not report its position.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>

#include "api/errors.h"
#include "api/should_stop.h"
#include "api/types.h"

namespace kdray::api {

/// What a JsonCursor throws to get out of the parser, which nothing else interrupts.
struct JsonStopped {};

/// An input iterator over a text that stores its position for the SAX handler.
class JsonCursor {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  /// Sets `*seen` to one past the last character read. Asks `*should_stop`, unless it is null, once
  /// in kBytesPerLook, and throws JsonStopped when it returns true. Both must outlive all copies of
  /// the cursor.
  JsonCursor(const char* at, const char** seen, const ShouldStop* should_stop = nullptr)
      : at_(at), seen_(seen), should_stop_(should_stop) {}

  reference operator*() const { return *at_; }
  JsonCursor& operator++() {
    *seen_ = ++at_;
    if (reinterpret_cast<std::uintptr_t>(at_) % kBytesPerLook == 0) [[unlikely]] {
      if (should_stop_ != nullptr && *should_stop_ && (*should_stop_)()) throw JsonStopped();
    }
    return *this;
  }
  JsonCursor operator++(int) {
    JsonCursor before = *this;
    ++*this;
    return before;
  }
  friend bool operator==(const JsonCursor& a, const JsonCursor& b) { return a.at_ == b.at_; }

 private:
  static constexpr std::uintptr_t kBytesPerLook = 1 << 16;

  const char* at_;
  const char** seen_;
  const ShouldStop* should_stop_;
};

/// The 1-based line of the token whose last character was read just before `seen`. O(text): for
/// errors and small texts.
std::uint64_t JsonLine(std::string_view text, const char* seen);

/// invalid_json or invalid_parameter about the token whose last character was read just before
/// `seen` (after a number, one more character was read, which may be a line end). `pointer` is the
/// JSON pointer (RFC 6901).
Problem JsonProblem(ErrorCode code, std::string_view text, const char* seen, std::string detail,
                    std::optional<std::string> pointer);

/// Call before parsing: nlohmann-json treats a NUL as the end of the text and would ignore the
/// rest. `name` is the text's name in messages, as in NotJson().
Check RefuseNul(std::string_view name, std::string_view text);

/// invalid_json from the parser's message: its line and column, without its exception type and the
/// text's bytes.
Problem NotJson(std::string_view name, std::string_view text, const char* seen,
                std::string_view parser_message);

}  // namespace kdray::api
