// SPDX-License-Identifier: Apache-2.0
#include "api/field_kind.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <utility>

#include "api/field_source.h"
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
  if (!kind.word.empty() && source.Word() == kind.word) return FieldValue(std::string(kind.word));
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
  return ReadList<double>(kind, NumberKind{kind.min, kind.max}, kind.count, source);
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

template <class Source>
Outcome<FieldValue> Read(const BooleanKind& kind, const Source& source) {
  const std::optional<bool> value = source.Boolean();
  if (!value) return source.Refuse(kind);
  return FieldValue(*value);
}

// ---- Lights ----

constexpr std::array<std::string_view, 4> kLightNames = {"direction", "position", "intensity",
                                                         "color"};

/// Reads one light. Messages name values by their JSON pointer; `parameter`, if not empty, replaces
/// the pointer as the problem's parameter.
class LightReader {
 public:
  LightReader(std::string pointer, std::string parameter)
      : pointer_(std::move(pointer)), parameter_(std::move(parameter)) {}

  Outcome<Light> Read(const JsonValue& value) const {
    const auto* object = std::get_if<JsonObject>(&value.value);
    if (object == nullptr) {
      return Refuse(ErrorCode::kInvalidJson, pointer_,
                    " must be an object, not " + std::string(value.KindName()));
    }
    Light light;
    for (const JsonMember& member : *object) {
      if (Check problem = ReadMember(member, &light)) return *std::move(problem);
    }
    if (light.direction.has_value() == light.position.has_value()) {
      return Refuse(ErrorCode::kInvalidParameter, pointer_,
                    " must have either a direction or a position");
    }
    if (light.direction == Vec3{}) {
      return Refuse(ErrorCode::kInvalidParameter, pointer_ + "/direction", " must not be 0,0,0");
    }
    return light;
  }

 private:
  Problem Refuse(ErrorCode code, const std::string& pointer, const std::string& why) const {
    return Problem{code, pointer + why, parameter_.empty() ? pointer : parameter_};
  }

  Check ReadMember(const JsonMember& member, Light* light) const {
    const std::string pointer = pointer_ + PointerStep(member.key);
    const auto read = [&](const auto& kind) {
      Outcome<FieldValue> value = api::Read(kind, JsonSource({pointer, pointer}, member.value));
      return parameter_.empty() ? std::move(value) : WithParameter(std::move(value));
    };
    if (member.key == "intensity") {
      const Outcome<FieldValue> value = read(NumberKind{.min = 0});
      if (!value) return value.problem();
      light->intensity = std::get<double>(*value);
      return std::nullopt;
    }
    if (std::find(kLightNames.begin(), kLightNames.end(), member.key) == kLightNames.end()) {
      return Refuse(ErrorCode::kInvalidParameter, pointer,
                    " is unknown; a light has " + Join(kLightNames));
    }
    const bool is_color = member.key == "color";
    const Outcome<FieldValue> value =
        read(is_color ? VectorKind{.min = 0, .max = 1} : VectorKind{});
    if (!value) return value.problem();
    const auto& numbers = std::get<std::vector<double>>(*value);
    const Vec3 vector = {numbers[0], numbers[1], numbers[2]};
    if (is_color) light->color = vector;
    if (member.key == "direction") light->direction = vector;
    if (member.key == "position") light->position = vector;
    return std::nullopt;
  }

  Outcome<FieldValue> WithParameter(Outcome<FieldValue> value) const {
    if (value) return value;
    Problem problem = std::move(value).problem();
    problem.parameter = parameter_;
    return problem;
  }

  std::string pointer_, parameter_;
};

Outcome<FieldValue> ReadLights(const LightsKind& kind, const Place& place, const JsonValue& value,
                               const std::string& parameter) {
  const auto* array = std::get_if<JsonArray>(&value.value);
  if (array == nullptr) {
    return place.Refuse(parameter.empty() ? ErrorCode::kInvalidJson : ErrorCode::kInvalidParameter,
                        kind, std::string(value.KindName()));
  }
  if (array->size() > kind.max) {
    Problem problem = place.Refuse(ErrorCode::kInvalidParameter, kind,
                                   std::to_string(array->size()) + " of them");
    problem.limit = static_cast<double>(kind.max);
    problem.actual = static_cast<double>(array->size());
    return problem;
  }
  std::vector<Light> lights;
  const std::string pointer = PointerStep(place.name);
  for (const JsonValue& element : *array) {
    Outcome<Light> light =
        LightReader(pointer + PointerStep(lights.size()), parameter).Read(element);
    if (!light) {
      Problem problem = std::move(light).problem();
      // As a parameter's text, a wrong kind of value is a wrong parameter.
      if (!parameter.empty()) problem.code = ErrorCode::kInvalidParameter;
      return problem;
    }
    lights.push_back(*std::move(light));
  }
  return FieldValue(std::move(lights));
}

Outcome<FieldValue> Read(const LightsKind& kind, const JsonSource& source) {
  return ReadLights(kind, source.place(), source.value(), "");
}

Outcome<FieldValue> Read(const LightsKind& kind, const TextSource& source) {
  std::string text(source.text());
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool is_sign = i > 0 && (text[i - 1] == 'e' || text[i - 1] == 'E');
    if (text[i] == '+' && !is_sign) text[i] = ' ';
  }
  constexpr std::size_t kDepth = 4;  // lights, light, vector, and one to name as wrong
  Outcome<JsonValue> value = ReadJsonValue(source.place().name, text, kDepth);
  if (value) return ReadLights(kind, source.place(), *value, source.place().parameter);
  Problem problem = std::move(value).problem();
  return Problem{ErrorCode::kInvalidParameter,
                 source.place().name + " must be " + Describe(kind) + ": " + problem.detail,
                 source.place().parameter};
}

std::string LightsText(const std::vector<Light>& lights) {
  const auto vector_text = [](const Vec3& v) {
    return '[' + NumberText(v[0]) + ',' + NumberText(v[1]) + ',' + NumberText(v[2]) + ']';
  };
  std::string text = "[";
  for (const Light& light : lights) {
    if (text.size() > 1) text += ',';
    text += light.direction ? "{\"direction\":" + vector_text(*light.direction)
                            : "{\"position\":" + vector_text(light.position.value_or(Vec3{}));
    if (light.intensity != 1) text += ",\"intensity\":" + NumberText(light.intensity);
    if (light.color != Vec3{1, 1, 1}) text += ",\"color\":" + vector_text(light.color);
    text += '}';
  }
  return text + ']';
}

}  // namespace

std::string Describe(const FieldKind& kind) {
  return std::visit(Overloaded{
                        [](const IntegerKind& k) { return "an integer" + Interval(k.min, k.max); },
                        [](const NumberKind& k) {
                          return "a number" + Interval(k.min, k.max, k.open_min, k.open_max) +
                                 (k.or_infinity ? " or inf" : "") +
                                 (k.word.empty() ? "" : " or " + std::string(k.word));
                        },
                        [](const VectorKind& k) {
                          return (k.count == 3 ? "three" : std::to_string(k.count)) + " numbers" +
                                 Interval(k.min, k.max, false, false) +
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
                        [](const BooleanKind&) { return std::string("true or false"); },
                        [](const LightsKind& k) {
                          return "an array of at most " + std::to_string(k.max) +
                                 " lights, each an object with a direction or a position";
                        },
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
          [&](bool is_true) { return std::string(is_true ? "true" : "false"); },
          [&](const std::vector<Light>& lights) { return LightsText(lights); },
      },
      value);
}

}  // namespace kdray::api
