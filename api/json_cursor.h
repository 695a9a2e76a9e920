// Where in its text a JSON parser is, and the refusals that say so. Shared by the two readers
// (api/json_batch.cc, api/json_reader.cc), which feed a SAX parser that does not tell its position.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>

#include "api/errors.h"
#include "api/types.h"

namespace kdray::api {

/// An input iterator over a text that leaves its position where the SAX handler can see it.
class JsonCursor {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  /// `seen` is set to one past the last character read; it must outlive the copies of the cursor.
  JsonCursor(const char* at, const char** seen) : at_(at), seen_(seen) {}

  reference operator*() const { return *at_; }
  JsonCursor& operator++() {
    *seen_ = ++at_;
    return *this;
  }
  JsonCursor operator++(int) {
    JsonCursor before = *this;
    ++*this;
    return before;
  }
  friend bool operator==(const JsonCursor& a, const JsonCursor& b) { return a.at_ == b.at_; }

 private:
  const char* at_;
  const char** seen_;
};

/// The 1-based line of the token whose last character was read just before `seen`. Costs a pass
/// over the text: for refusals and small texts.
std::uint64_t JsonLine(std::string_view text, const char* seen);

/// invalid_json or invalid_parameter about the token whose last character was read just before
/// `seen` (a number's next character is read too, which may be the end of its line). `pointer` is
/// the JSON pointer (RFC 6901).
Problem JsonProblem(ErrorCode code, std::string_view text, const char* seen, std::string detail,
                    std::optional<std::string> pointer);

/// Call before parsing: nlohmann-json takes a NUL for the end of the text and would not see what
/// stands behind it.
Check RefuseNul(std::string_view text);

/// invalid_json from the parser's own message, which names line and column, but also its own type
/// and whatever bytes came.
Problem NotJson(std::string_view text, const char* seen, std::string_view parser_message);

}  // namespace kdray::api
