// SPDX-License-Identifier: Apache-2.0
// The contract as JSON, for tests that compare it with the code.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "api/openapi_document.h"

namespace kdray::api {

using nlohmann::json;

inline const json& Document() {
  static const json document = json::parse(OpenApiJson());
  return document;
}

/// The value that `$ref` leads to, or the value itself.
inline const json& Resolve(const json& value) {
  if (!value.is_object() || !value.contains("$ref")) return value;
  return Resolve(Document().at(json::json_pointer(value["$ref"].get<std::string>().substr(1))));
}

template <class Visit>
void ForEachValue(const json& value, const Visit& visit) {
  visit(value);
  if (value.is_structured()) {
    for (const json& inner : value) ForEachValue(inner, visit);
  }
}

/// Null where the key is missing.
inline json At(const json& object, const char* key) { return object.value(key, json()); }

inline json Example(const std::string& pointer) {
  return Document().at(json::json_pointer(pointer)).at("value");
}

}  // namespace kdray::api
