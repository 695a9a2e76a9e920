// SPDX-License-Identifier: Apache-2.0
// JSON values for small answers, kept as the text that they become. nlohmann-json's values are not
// used for answers, because their destructors allocate: a failure there ends the process.
#pragma once

#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace kdray::api {

/// A value's text (UTF-8, no blanks). Doubles have a point or an exponent, as `1.0`; those that are
/// not finite are null. Bytes of a string that are not UTF-8 become U+FFFD.
class JsonValue {
 public:
  using Member = std::pair<std::string_view, JsonValue>;

  JsonValue() : text_("null") {}
  // NOLINTBEGIN(google-explicit-constructor)
  JsonValue(bool value) : text_(value ? "true" : "false") {}
  template <std::integral T>
  requires(!std::same_as<T, bool>) JsonValue(T value) : text_(std::to_string(value)) {}
  JsonValue(double value);
  JsonValue(std::string_view value);
  JsonValue(const std::string& value) : JsonValue(std::string_view(value)) {}
  JsonValue(const char* value) : JsonValue(std::string_view(value)) {}
  template <class T>
  JsonValue(const std::optional<T>& value) : JsonValue(value ? JsonValue(*value) : JsonValue()) {}
  /// An object, in this order.
  JsonValue(std::initializer_list<Member> members);
  // NOLINTEND(google-explicit-constructor)

  /// An array of the values of a range.
  template <class Range>
  static JsonValue Array(const Range& range) {
    JsonValue array = Empty("[]");
    for (const auto& value : range) array.Insert(JsonValue(value).text_);
    return array;
  }

  /// Appends a member to an object, or an element to an array.
  void Add(std::string_view name, const JsonValue& value);
  void Append(const JsonValue& value) { Insert(value.text_); }

  const std::string& text() const& { return text_; }
  std::string text() && { return std::move(text_); }

 private:
  static JsonValue Empty(std::string_view brackets);
  void Insert(std::string_view text);

  std::string text_;
};

}  // namespace kdray::api
