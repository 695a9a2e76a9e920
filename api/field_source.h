// SPDX-License-Identifier: Apache-2.0
// Where a field's value comes from: a parameter's text or a JSON value. Both sources have the same
// interface, so a kind of field (api/field_kind.cc) has the same range and error texts in both.
#pragma once

#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "api/errors.h"
#include "api/field_kind.h"
#include "api/json_pointer.h"
#include "api/json_reader.h"
#include "api/json_text.h"
#include "api/quoted.h"
#include "api/types.h"

namespace kdray::api {

/// The field or element that an error is about: in words, and as `parameter`.
struct Place {
  std::string name, parameter;

  Place Element(std::size_t i) const {
    const bool is_pointer = name.starts_with('/');
    return {name + (is_pointer ? PointerStep(i) : "[" + std::to_string(i) + "]"), parameter};
  }
  Problem Refuse(ErrorCode code, const FieldKind& kind, const std::string& came) const {
    return Problem{code, name + " must be " + Describe(kind) + ", not " + came, parameter};
  }
};

class TextSource {
 public:
  TextSource(Place place, std::string_view text) : place_(std::move(place)), text_(text) {}

  const Place& place() const { return place_; }
  static constexpr ErrorCode kWrongKind = ErrorCode::kInvalidParameter;
  Problem Refuse(const FieldKind& kind) const {
    return place_.Refuse(kWrongKind, kind, Quoted(text_));
  }

  Outcome<std::int64_t> Integer(const FieldKind& kind) const {
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(text_.data(), End(), value);
    if (error != std::errc() || end != End()) return Refuse(kind);
    return value;
  }
  Outcome<double> Number(const FieldKind& kind) const {
    double value = 0;
    // A plus sign may precede a number, which std::from_chars does not take.
    const bool has_plus = text_.size() > 1 && text_[0] == '+' && text_[1] != '-';
    const char* const begin = text_.data() + (has_plus ? 1 : 0);
    const auto [end, error] = std::from_chars(begin, End(), value);
    if (end != End() || (error != std::errc() && error != std::errc::result_out_of_range)) {
      return Refuse(kind);
    }
    // Out of range means too large, or so small that the nearest double is 0.
    if (error != std::errc()) value = std::strtod(std::string(text_).c_str(), nullptr);
    if (!std::isfinite(value)) return Refuse(kind);
    return value;
  }
  std::optional<std::string_view> Word() const { return text_; }
  std::optional<bool> Boolean() const {
    if (text_ == "true") return true;
    return text_ == "false" ? std::optional<bool>(false) : std::nullopt;
  }
  std::string_view text() const { return text_; }

  Outcome<std::vector<TextSource>> Elements(const FieldKind&) const {
    std::vector<TextSource> elements;
    std::string_view rest = text_;
    for (;;) {
      const std::size_t comma = rest.find(',');
      elements.emplace_back(place_.Element(elements.size()), rest.substr(0, comma));
      if (comma == std::string_view::npos) return elements;
      rest.remove_prefix(comma + 1);
    }
  }

 private:
  const char* End() const { return text_.data() + text_.size(); }

  Place place_;
  std::string_view text_;
};

class JsonSource {
 public:
  JsonSource(Place place, const JsonValue& value) : place_(std::move(place)), value_(&value) {}

  const Place& place() const { return place_; }
  static constexpr ErrorCode kWrongKind = ErrorCode::kInvalidJson;
  Problem Refuse(const FieldKind& kind) const {
    if (const auto* text = std::get_if<std::string>(&value_->value)) {
      return place_.Refuse(ErrorCode::kInvalidParameter, kind, Quoted(*text));
    }
    return WrongKind(kind);
  }

  Outcome<std::int64_t> Integer(const FieldKind& kind) const {
    const auto* number = std::get_if<JsonNumber>(&value_->value);
    if (number == nullptr) return WrongKind(kind);
    if (number->integer) return *number->integer;
    return place_.Refuse(ErrorCode::kInvalidParameter, kind, NumberText(number->value));
  }
  Outcome<double> Number(const FieldKind& kind) const {
    const auto* number = std::get_if<JsonNumber>(&value_->value);
    if (number == nullptr) return WrongKind(kind);
    return number->value;
  }
  std::optional<std::string_view> Word() const {
    const auto* text = std::get_if<std::string>(&value_->value);
    return text == nullptr ? std::nullopt : std::optional<std::string_view>(*text);
  }
  std::optional<bool> Boolean() const {
    const auto* boolean = std::get_if<bool>(&value_->value);
    return boolean == nullptr ? std::nullopt : std::optional<bool>(*boolean);
  }
  const JsonValue& value() const { return *value_; }

  Outcome<std::vector<JsonSource>> Elements(const FieldKind& kind) const {
    const auto* array = std::get_if<JsonArray>(&value_->value);
    if (array == nullptr) return WrongKind(kind);
    std::vector<JsonSource> elements;
    for (const JsonValue& element : *array) {
      Place place = place_.Element(elements.size());
      place.parameter += PointerStep(elements.size());
      elements.emplace_back(std::move(place), element);
    }
    return elements;
  }

 private:
  Problem WrongKind(const FieldKind& kind) const {
    return place_.Refuse(kWrongKind, kind, std::string(value_->KindName()));
  }

  Place place_;
  const JsonValue* value_;
};

}  // namespace kdray::api
