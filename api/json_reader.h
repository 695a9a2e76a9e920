// SPDX-License-Identifier: Apache-2.0
// Reads small JSON objects strictly: requests of at most a page. For batches: api/json_batch.h.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "api/types.h"

namespace kdray::api {

struct JsonNumber {
  double value = 0;
  /// Set if the text is certainly an integer: written without fraction and exponent, or an integral
  /// double below 2^53 (1.0, 1e3).
  std::optional<std::int64_t> integer;
};

struct JsonMember;

struct JsonValue {
  std::variant<std::nullptr_t, bool, JsonNumber, std::string, std::vector<JsonValue>,
               std::vector<JsonMember>>
      value;
  std::uint64_t line = 1;  ///< 1-based line where its text ends (for arrays and objects: begins)

  /// "null", "a boolean", "a number", "a string", "an array", "an object".
  std::string_view KindName() const;
};
using JsonArray = std::vector<JsonValue>;
using JsonObject = std::vector<JsonMember>;  ///< in the order of the text, keys unique

struct JsonMember {
  std::string key;
  JsonValue value;
};

/// Values in one text, keys of objects not counted.
inline constexpr std::size_t kMaxJsonValues = 4096;

/// Errors: invalid_json, with the line and, where known, the JSON pointer: text that is not JSON
/// (RFC 8259), more than one value, a value that is not an object, invalid UTF-8, a number beyond
/// the range of double, a repeated key, brackets nested deeper than `max_depth`, more than
/// kMaxJsonValues values.
Outcome<JsonObject> ReadJsonObject(std::string_view text, std::size_t max_depth);
/// The same for one value of any kind, in a text that messages call `name`.
Outcome<JsonValue> ReadJsonValue(std::string_view name, std::string_view text,
                                 std::size_t max_depth);

}  // namespace kdray::api
