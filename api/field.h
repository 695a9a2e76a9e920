// SPDX-License-Identifier: Apache-2.0
// Fields of requests as data. A table for each request (api/request_fields.h) gives each field's
// name, its allowed values and its member. The same table serves to read the field from query
// parameters or a JSON object, to report errors, to write the canonical text, and to check the
// documentation.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "api/field_kind.h"
#include "api/json_pointer.h"
#include "api/json_reader.h"
#include "api/query_string.h"
#include "api/types.h"

namespace kdray::api {

// ---- A field of `Request` ----

template <class Request>
struct Field {
  std::string_view name;
  FieldKind kind;
  std::function<void(Request&, FieldValue)> set;
  std::function<std::optional<FieldValue>(const Request&)> get;  ///< nullopt: absent
  bool required = false;
  bool shapes_answer = true;  ///< false: the answer's bytes do not depend on it
};

template <class Request>
struct FieldTable {
  std::vector<Field<Request>> fields;
};

namespace field_detail {

template <class T>
struct IsOptional : std::false_type {};
template <class T>
struct IsOptional<std::optional<T>> : std::true_type {};
template <class T>
struct IsNumbers : std::false_type {};
template <std::size_t kCount>
struct IsNumbers<std::array<double, kCount>> : std::true_type {};
template <class T>
struct IsVector : std::false_type {};
template <class T>
struct IsVector<std::vector<T>> : std::true_type {};

template <class T>
void Assign(T& member, FieldValue value) {
  if constexpr (IsOptional<T>::value) {
    Assign(member.emplace(), std::move(value));
  } else if constexpr (std::is_same_v<T, bool> || std::is_same_v<T, std::vector<Light>>) {
    member = std::get<T>(std::move(value));
  } else if constexpr (std::is_enum_v<T> || std::is_integral_v<T>) {
    member = static_cast<T>(std::get<std::int64_t>(value));
  } else if constexpr (IsNumbers<T>::value) {
    const auto& numbers = std::get<std::vector<double>>(value);
    std::copy_n(numbers.begin(), member.size(), member.begin());
  } else if constexpr (std::is_same_v<T, Region>) {
    const auto& numbers = std::get<std::vector<std::int64_t>>(value);
    member = {numbers[0], numbers[1], numbers[2], numbers[3]};
  } else if constexpr (IsVector<T>::value) {
    member.clear();
    for (const std::int64_t index : std::get<std::vector<std::int64_t>>(value)) {
      member.push_back(static_cast<typename T::value_type>(index));
    }
  } else {
    member = std::get<T>(std::move(value));
  }
}

template <class T>
std::optional<FieldValue> Fetch(const T& member) {
  if constexpr (IsOptional<T>::value) {
    return member ? Fetch(*member) : std::nullopt;
  } else if constexpr (std::is_same_v<T, bool> || std::is_same_v<T, std::vector<Light>>) {
    return member;
  } else if constexpr (std::is_enum_v<T> || std::is_integral_v<T>) {
    return static_cast<std::int64_t>(member);
  } else if constexpr (IsNumbers<T>::value) {
    return std::vector<double>(member.begin(), member.end());
  } else if constexpr (std::is_same_v<T, Region>) {
    return std::vector<std::int64_t>{member.x0, member.y0, member.x1, member.y1};
  } else if constexpr (IsVector<T>::value) {
    std::vector<std::int64_t> indices;
    indices.reserve(member.size());
    for (const auto choice : member) indices.push_back(static_cast<std::int64_t>(choice));
    return indices;
  } else {
    return member;
  }
}

}  // namespace field_detail

/// A field that is one member of the request.
template <class Request, class T>
Field<Request> MemberField(std::string_view name, FieldKind kind, T Request::*member) {
  return {name, kind,
          [member](Request& request, FieldValue value) {
            field_detail::Assign(request.*member, std::move(value));
          },
          [member](const Request& request) { return field_detail::Fetch(request.*member); }};
}

// ---- Whole requests ----

/// "there is no 'x' here; there are a, b".
Problem UnknownField(std::string_view name, const std::vector<std::string_view>& names);
Problem MissingField(std::string_view name, const FieldKind& kind);

template <class Request>
const Field<Request>* FindField(const FieldTable<Request>& table, std::string_view name) {
  for (const Field<Request>& field : table.fields) {
    if (field.name == name) return &field;
  }
  return nullptr;
}

template <class Request>
Problem UnknownField(const FieldTable<Request>& table, std::string_view name) {
  std::vector<std::string_view> names;
  names.reserve(table.fields.size());
  for (const Field<Request>& field : table.fields) names.push_back(field.name);
  return UnknownField(name, names);
}

/// Fills a Request from a query; absent fields keep their defaults.
template <class Request>
Outcome<Request> ReadQuery(const FieldTable<Request>& table, std::string_view query) {
  const Outcome<std::vector<Parameter>> parameters = ParseQuery(query);
  if (!parameters) return parameters.problem();
  Request request;
  for (const Parameter& parameter : *parameters) {
    const Field<Request>* field = FindField(table, parameter.name);
    if (field == nullptr) return UnknownField(table, parameter.name);
    Outcome<FieldValue> value = ReadText(field->name, field->kind, parameter.value);
    if (!value) return std::move(value).problem();
    field->set(request, *std::move(value));
  }
  for (const Field<Request>& field : table.fields) {
    if (!field.required) continue;
    bool given = false;
    for (const Parameter& parameter : *parameters) given = given || parameter.name == field.name;
    if (!given) return MissingField(field.name, field.kind);
  }
  return request;
}

/// The same from a JSON object. The problem's `parameter` is a JSON pointer, and it has the line.
template <class Request>
Outcome<Request> ReadObject(const FieldTable<Request>& table, const JsonObject& object) {
  Request request;
  for (const JsonMember& member : object) {
    const auto refuse = [&](Problem problem) {
      problem.line = member.value.line;
      return problem;
    };
    const Field<Request>* field = FindField(table, member.key);
    if (field == nullptr) {
      Problem problem = UnknownField(table, member.key);
      problem.parameter = PointerStep(member.key);
      return refuse(std::move(problem));
    }
    Outcome<FieldValue> value = ReadJson(field->name, field->kind, member.value);
    if (!value) return refuse(std::move(value).problem());
    field->set(request, *std::move(value));
  }
  return request;
}

/// `name=value&…` of every field that affects the answer, in the table's order, with defaults.
template <class Request>
std::string CanonicalText(const FieldTable<Request>& table, const Request& request) {
  std::string text;
  for (const Field<Request>& field : table.fields) {
    const std::optional<FieldValue> value = field.get(request);
    if (!field.shapes_answer || !value) continue;
    if (!text.empty()) text += '&';
    text += std::string(field.name) + '=' + WriteText(field.kind, *value);
  }
  return text;
}

}  // namespace kdray::api
