// SPDX-License-Identifier: Apache-2.0
// The kinds of fields of requests, and their values: read from a parameter's text or from JSON, and
// written as text. The tables of fields (api/request_fields.h) consist of these.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "api/json_reader.h"
#include "api/types.h"

namespace kdray::api {

// ---- What a field takes ----

/// `min` to `max`, both ends included.
struct IntegerKind {
  std::int64_t min = 0, max = 0;
};
/// A finite number in the interval; an open end is excluded.
struct NumberKind {
  double min = std::numeric_limits<double>::lowest(), max = std::numeric_limits<double>::max();
  bool open_min = false, open_max = false;
  bool or_infinity = false;    ///< also the word `inf`, as a parameter
  std::string_view word = {};  ///< a word that is allowed instead
};
/// `count` finite numbers from `min` to `max`: `1,2,3` as a parameter, an array in JSON.
struct VectorKind {
  double min = std::numeric_limits<double>::lowest(), max = std::numeric_limits<double>::max();
  std::string_view word = {};  ///< a word that is allowed instead
  std::size_t count = 3;
};
/// `count` integers: `1,2` as a parameter, an array in JSON.
struct IntegersKind {
  std::size_t count = 0;
  std::int64_t min = 0, max = 0;
};
/// One of `names`.
struct ChoiceKind {
  std::span<const std::string_view> names;
};
/// At least one of `names`, each at most once, separated by commas.
struct ChoicesKind {
  std::span<const std::string_view> names;
};
/// A text that `accepts` takes.
struct TextKind {
  bool (*accepts)(std::string_view);
  std::string_view wanted;  ///< in words
};
/// `true` or `false`, also as a parameter.
struct BooleanKind {};
/// A list of lights: an array of objects in JSON, its text as a parameter.
struct LightsKind {
  std::size_t max = 0;
};
using FieldKind = std::variant<IntegerKind, NumberKind, VectorKind, IntegersKind, ChoiceKind,
                               ChoicesKind, TextKind, BooleanKind, LightsKind>;

/// The allowed values of `kind` in words: "an integer from 1 to 1024".
std::string Describe(const FieldKind& kind);

// ---- Its value ----

/// integer, index of a choice; number; integers, indices of choices; vector; text, or the word of a
/// number or vector; boolean; lights.
using FieldValue = std::variant<std::int64_t, double, std::vector<std::int64_t>,
                                std::vector<double>, std::string, bool, std::vector<Light>>;

/// A parameter's text: invalid_parameter. In that of lights, a plus sign is a blank unless it
/// follows e or E.
Outcome<FieldValue> ReadText(std::string_view name, const FieldKind& kind, std::string_view text);
/// A JSON value: invalid_json for the wrong kind of value, invalid_parameter for the right kind
/// outside the range.
Outcome<FieldValue> ReadJson(std::string_view name, const FieldKind& kind, const JsonValue& value);
/// The shortest text that ReadText reads back.
std::string WriteText(const FieldKind& kind, const FieldValue& value);

}  // namespace kdray::api
