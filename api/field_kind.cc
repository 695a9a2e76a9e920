#include "api/field_kind.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <utility>

#include "api/json_pointer.h"
#include "api/json_text.h"
#include "api/quoted.h"

namespace kdray::api {
namespace {

template <class... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};
template <class... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;

constexpr double kLowest = std::numeric_limits<double>::lowest();
constexpr double kHighest = std::numeric_limits<double>::max();

// ---- Words ----

std::string Join(std::span<const std::string_view> names) {
  std::string text;
  for (const std::string_view name : names) {
    if (!text.empty()) text += ", ";
    text += name;
  }
  return text;
}

std::string Interval(double min, double max, bool open_min, bool open_max) {
  if (min == kLowest && max == kHighest) return "";
  if (!open_min && !open_max && max != kHighest)
    return " from " + NumberText(min) + " to " + NumberText(max);
  std::string text = (open_min ? " above " : " of at least ") + NumberText(min);
  if (max != kHighest) text += (open_max ? " and below " : " and at most ") + NumberText(max);
  return text;
}

std::string Interval(std::int64_t min, std::int64_t max) {
  return " from " + std::to_string(min) + " to " + std::to_string(max);
}

// ---- Where a value comes from ---- Two sources with one interface: a parameter's text and a JSON
// value. Read() below uses either, so both have the same ranges and error texts.

/// The field or element that an error is about: in words, and as `parameter`.
struct Place {
  std::string name, parameter;

  Place Element(std::size_t i) const { return {name + "[" + std::to_string(i) + "]", parameter}; }
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
    const auto [end, error] = std::from_chars(text_.data(), End(), value);
    if (end != End() || (error != std::errc() && error != std::errc::result_out_of_range)) {
      return Refuse(kind);
    }
    // Out of range means too large, or so small that the nearest double is 0.
    if (error != std::errc()) value = std::strtod(std::string(text_).c_str(), nullptr);
    if (!std::isfinite(value)) return Refuse(kind);
    return value;
  }
  std::optional<std::string_view> Word() const { return text_; }

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

// ---- The kinds ----

template <class T>
Problem OutOfRange(const Place& place, const FieldKind& kind, T value, T min, T max,
                   const std::string& came) {
  Problem problem = place.Refuse(ErrorCode::kInvalidParameter, kind, came);
  problem.limit = static_cast<double>(value <= min ? min : max);
  problem.actual = static_cast<double>(value);
  return problem;
}

template <class Source>
Outcome<FieldValue> Read(const IntegerKind& kind, const Source& source) {
  const Outcome<std::int64_t> value = source.Integer(kind);
  if (!value) return value.problem();
  if (*value >= kind.min && *value <= kind.max) return FieldValue(*value);
  return OutOfRange(source.place(), kind, *value, kind.min, kind.max, std::to_string(*value));
}

template <class Source>
Outcome<FieldValue> Read(const NumberKind& kind, const Source& source) {
  if (kind.or_infinity && source.Word() == "inf") {
    return FieldValue(std::numeric_limits<double>::infinity());
  }
  const Outcome<double> value = source.Number(kind);
  if (!value) return value.problem();
  const bool above = kind.open_min ? *value > kind.min : *value >= kind.min;
  const bool below = kind.open_max ? *value < kind.max : *value <= kind.max;
  if (above && below) return FieldValue(*value);
  return OutOfRange(source.place(), kind, *value, kind.min, kind.max, NumberText(*value));
}

template <class Source>
Outcome<FieldValue> Read(const ChoiceKind& kind, const Source& source) {
  const std::optional<std::string_view> word = source.Word();
  if (!word) return source.Refuse(kind);
  const auto found = std::find(kind.names.begin(), kind.names.end(), *word);
  if (found != kind.names.end()) return FieldValue(std::int64_t{found - kind.names.begin()});
  return source.Refuse(kind);
}

/// A list of `count` items (0: at least one), each read as `element_kind`.
template <class Item, class ElementKind, class Source>
Outcome<FieldValue> ReadList(const FieldKind& kind, const ElementKind& element_kind,
                             std::size_t count, const Source& source) {
  const Outcome<std::vector<Source>> elements = source.Elements(kind);
  if (!elements) return elements.problem();
  const std::size_t size = elements->size();
  if (count == 0 ? size == 0 : size != count) {
    return source.place().Refuse(Source::kWrongKind, kind, std::to_string(size) + " of them");
  }
  std::vector<Item> items;
  for (const Source& element : *elements) {
    const Outcome<FieldValue> item = Read(element_kind, element);
    if (!item) return item.problem();
    items.push_back(std::get<Item>(*item));
  }
  return FieldValue(std::move(items));
}

template <class Source>
Outcome<FieldValue> Read(const VectorKind& kind, const Source& source) {
  if (!kind.word.empty() && source.Word() == kind.word) return FieldValue(std::string(kind.word));
  return ReadList<double>(kind, NumberKind{kind.min, kind.max}, 3, source);
}

template <class Source>
Outcome<FieldValue> Read(const IntegersKind& kind, const Source& source) {
  return ReadList<std::int64_t>(kind, IntegerKind{kind.min, kind.max}, kind.count, source);
}

template <class Source>
Outcome<FieldValue> Read(const ChoicesKind& kind, const Source& source) {
  Outcome<FieldValue> list = ReadList<std::int64_t>(kind, ChoiceKind{kind.names}, 0, source);
  if (!list) return list;
  std::vector<std::int64_t> sorted = std::get<std::vector<std::int64_t>>(*list);
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) return source.Refuse(kind);
  return list;
}

template <class Source>
Outcome<FieldValue> Read(const TextKind& kind, const Source& source) {
  const std::optional<std::string_view> word = source.Word();
  if (!word || !kind.accepts(*word)) return source.Refuse(kind);
  return FieldValue(std::string(*word));
}

}  // namespace

std::string Describe(const FieldKind& kind) {
  return std::visit(Overloaded{
                        [](const IntegerKind& k) { return "an integer" + Interval(k.min, k.max); },
                        [](const NumberKind& k) {
                          return "a number" + Interval(k.min, k.max, k.open_min, k.open_max) +
                                 (k.or_infinity ? " or inf" : "");
                        },
                        [](const VectorKind& k) {
                          return "three numbers" + Interval(k.min, k.max, false, false) +
                                 (k.word.empty() ? "" : " or " + std::string(k.word));
                        },
                        [](const IntegersKind& k) {
                          return std::to_string(k.count) + " integers" + Interval(k.min, k.max);
                        },
                        [](const ChoiceKind& k) { return "one of " + Join(k.names); },
                        [](const ChoicesKind& k) {
                          return "a list, with commas between and each at most once, of " +
                                 Join(k.names);
                        },
                        [](const TextKind& k) { return std::string(k.wanted); },
                    },
                    kind);
}

Outcome<FieldValue> ReadText(std::string_view name, const FieldKind& kind, std::string_view text) {
  const TextSource source({std::string(name), std::string(name)}, text);
  return std::visit([&](const auto& k) { return Read(k, source); }, kind);
}

Outcome<FieldValue> ReadJson(std::string_view name, const FieldKind& kind, const JsonValue& value) {
  const JsonSource source({std::string(name), PointerStep(name)}, value);
  return std::visit([&](const auto& k) { return Read(k, source); }, kind);
}

std::string WriteText(const FieldKind& kind, const FieldValue& value) {
  const auto list = [](const auto& items, auto item_text) {
    std::string text;
    for (const auto& item : items) {
      if (!text.empty()) text += ',';
      text += item_text(item);
    }
    return text;
  };
  return std::visit(
      Overloaded{
          [&](std::int64_t number) {
            const auto* choice = std::get_if<ChoiceKind>(&kind);
            return choice == nullptr ? std::to_string(number)
                                     : std::string(choice->names[static_cast<std::size_t>(number)]);
          },
          [&](double number) {
            return std::isinf(number) ? std::string("inf") : NumberText(number);
          },
          [&](const std::vector<std::int64_t>& numbers) {
            const auto* choices = std::get_if<ChoicesKind>(&kind);
            return list(numbers, [&](std::int64_t number) {
              return choices == nullptr
                         ? std::to_string(number)
                         : std::string(choices->names[static_cast<std::size_t>(number)]);
            });
          },
          [&](const std::vector<double>& numbers) { return list(numbers, NumberText); },
          [&](const std::string& text) { return text; },
      },
      value);
}

}  // namespace kdray::api
