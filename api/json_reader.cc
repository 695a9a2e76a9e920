// SPDX-License-Identifier: Apache-2.0
#include "api/json_reader.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "api/json_cursor.h"
#include "api/json_pointer.h"
#include "api/quoted.h"

namespace kdray::api {
namespace {

using nlohmann::json;

/// SAX handler that builds the value and rejects what a document tree would hide: duplicate keys,
/// depth, and the text of numbers.
class Builder {
 public:
  /// `name` is the text's name in messages.
  Builder(std::string_view name, std::string_view text, std::size_t max_depth, bool object_only)
      : name_(name), text_(text), max_depth_(max_depth), object_only_(object_only) {}

  Outcome<JsonValue> Read() {
    if (Check problem = RefuseNul(name_, text_)) return *std::move(problem);
    json::sax_parse(JsonCursor(text_.data(), &seen_),
                    JsonCursor(text_.data() + text_.size(), &seen_), this);
    if (problem_) return *std::move(problem_);
    return std::move(root_);
  }

  bool null() { return Add(nullptr); }
  bool boolean(bool value) { return Add(value); }
  bool string(std::string& value) { return Add(std::move(value)); }
  bool binary(json::binary_t&) { return false; }  // JSON text has none
  bool number_integer(json::number_integer_t value) {
    // Numbers without a minus come as unsigned, so this 0 was written "-0".
    return Add(JsonNumber{value == 0 ? -0.0 : static_cast<double>(value), value});
  }
  bool number_unsigned(json::number_unsigned_t value) {
    JsonNumber number{static_cast<double>(value), std::nullopt};
    if (value <= static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())) {
      number.integer = static_cast<std::int64_t>(value);
    }
    return Add(number);
  }
  bool number_float(double value, const std::string&) {
    JsonNumber number{value, std::nullopt};
    // From 2^53 on, a double may represent several integers.
    if (std::trunc(value) == value && std::fabs(value) < 9007199254740992.0) {
      number.integer = static_cast<std::int64_t>(value);
    }
    return Add(number);
  }

  bool start_object(std::size_t) { return Open(JsonObject()); }
  bool end_object() { return Close(); }
  bool start_array(std::size_t) { return Open(JsonArray()); }
  bool end_array() { return Close(); }

  bool key(std::string& key) {
    auto& members = std::get<JsonObject>(open_.back()->value);
    const bool twice = std::any_of(members.begin(), members.end(),
                                   [&](const JsonMember& member) { return member.key == key; });
    members.push_back({std::move(key), {}});
    if (twice) return Fail("the key " + Quoted(members.back().key) + " is repeated");
    return true;
  }

  bool parse_error(std::size_t, const std::string& last_token, const json::exception& error) {
    constexpr int kNumberOverflow = 406;
    if (error.id == kNumberOverflow) {
      // A placeholder for the number, so the pointer leads to it.
      return Add(nullptr) &&
             Fail("the number " + Quoted(last_token) + " is beyond the range of double");
    }
    problem_ = NotJson(name_, text_, seen_, error.what());
    return false;
  }

 private:
  /// Adds `value` at the parser's position; null if it is not allowed there.
  JsonValue* Place(JsonValue value) {
    value.line = Line();
    if (++values_ > kMaxJsonValues) {
      Fail(name_ + " has more than " + std::to_string(kMaxJsonValues) + " values");
      return nullptr;
    }
    if (open_.empty()) {
      root_ = std::move(value);
      if (!object_only_ || std::holds_alternative<JsonObject>(root_.value)) return &root_;
      Fail(name_ + " must be an object, not " + std::string(root_.KindName()));
      return nullptr;
    }
    if (auto* array = std::get_if<JsonArray>(&open_.back()->value)) {
      array->push_back(std::move(value));
      return &array->back();
    }
    JsonValue& member = std::get<JsonObject>(open_.back()->value).back().value;
    member = std::move(value);
    return &member;
  }

  /// JsonLine(), continuing from the previous value.
  std::uint64_t Line() {
    line_ += JsonLine({counted_, static_cast<std::size_t>(seen_ - counted_)}, seen_) - 1;
    counted_ = seen_ - 1;
    return line_;
  }

  template <class T>
  bool Add(T value) {
    return Place(JsonValue{std::move(value)}) != nullptr;
  }

  /// Elements of an open array do not move: the array grows only after they are closed.
  template <class T>
  bool Open(T empty) {
    JsonValue* placed = Place(JsonValue{std::move(empty)});
    if (placed == nullptr) return false;
    if (open_.size() == max_depth_) {
      return Fail(name_ + " nests deeper than " + std::to_string(max_depth_) + " levels");
    }
    open_.push_back(placed);
    return true;
  }

  bool Close() {
    open_.pop_back();
    return true;
  }

  bool Fail(std::string detail) {
    problem_ = JsonProblem(ErrorCode::kInvalidJson, text_, seen_, std::move(detail), std::string());
    for (const JsonValue* value : open_) {
      if (const auto* array = std::get_if<JsonArray>(&value->value)) {
        *problem_->parameter += PointerStep(array->empty() ? 0 : array->size() - 1);
      } else {
        *problem_->parameter += PointerStep(std::get<JsonObject>(value->value).back().key);
      }
    }
    return false;
  }

  std::string name_;
  std::string_view text_;
  std::size_t max_depth_;
  bool object_only_;
  const char* seen_ = text_.data();
  const char* counted_ = text_.data();
  std::uint64_t line_ = 1;
  std::size_t values_ = 0;
  JsonValue root_;
  std::vector<JsonValue*> open_;
  Check problem_;
};

}  // namespace

std::string_view JsonValue::KindName() const {
  constexpr std::array<std::string_view, 6> kNames = {"null",     "a boolean", "a number",
                                                      "a string", "an array",  "an object"};
  return kNames[value.index()];
}

Outcome<JsonObject> ReadJsonObject(std::string_view text, std::size_t max_depth) {
  Outcome<JsonValue> value = Builder("the body", text, max_depth, true).Read();
  if (!value) return std::move(value).problem();
  return std::get<JsonObject>(std::move(value->value));
}

Outcome<JsonValue> ReadJsonValue(std::string_view name, std::string_view text,
                                 std::size_t max_depth) {
  return Builder(name, text, max_depth, false).Read();
}

}  // namespace kdray::api
