// SPDX-License-Identifier: Apache-2.0
// openapi.yaml is what clients are written from, the tables are what requests are read with: this
// compares the two. openapi_examples_test.cc compares the examples.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "api/errors.h"
#include "api/names.h"
#include "api/request_fields.h"
#include "tests/unit/api/openapi_json.h"

namespace kdray::api {
namespace {

TEST(OpenApi, HasNoReferenceThatLeadsNowhere) {
  int references = 0;
  ForEachValue(Document(), [&](const json& value) {
    if (!value.is_object() || !value.contains("$ref")) return;
    const std::string reference = value["$ref"];
    ASSERT_EQ(reference.substr(0, 2), "#/") << reference;
    EXPECT_TRUE(Document().contains(json::json_pointer(reference.substr(1)))) << reference;
    ++references;
  });
  EXPECT_GT(references, 100);
}

TEST(OpenApi, HoldsItsExamples) {
  int examples = 0;
  ForEachValue(Document(), [&](const json& value) {
    if (value.is_object() && value.contains("examples")) {
      for (const json& example : value["examples"]) examples += example.contains("value");
    }
    EXPECT_FALSE(value.is_object() && value.contains("externalValue"));
  });
  EXPECT_GT(examples, 10);
}

TEST(OpenApi, NamesEveryOperationOnce) {
  std::set<std::string> ids;
  for (const auto& [path, item] : Document()["paths"].items()) {
    for (const char* method : {"get", "post", "delete"}) {
      if (!item.contains(method)) continue;
      const json& operation = item[method];
      EXPECT_TRUE(ids.insert(operation["operationId"]).second) << path;
      EXPECT_TRUE(operation.contains("summary")) << path;
      EXPECT_TRUE(operation["responses"].contains("default")) << path;
    }
  }
}

TEST(OpenApi, ListsExactlyTheProblemCodesThereAre) {
  std::vector<std::string> codes;
  for (const ErrorRow& row : ErrorTable()) codes.emplace_back(Name(row.code));
  EXPECT_EQ(Document()["components"]["schemas"]["ProblemCode"]["enum"], json(codes));
}

TEST(OpenApi, SaysWhereEachProblemComesWithItsStatus) {
  for (const ErrorRow& row : ErrorTable()) {
    bool found = false;
    const auto look = [&](const std::string& status, const json& response) {
      const std::string text = Resolve(response)["description"];
      if (text.find(Name(row.code)) == std::string::npos) return;
      found = true;
      EXPECT_TRUE(status == "default" || status == std::to_string(row.status))
          << Name(row.code) << " stands at status " << status;
    };
    for (const json& item : Document()["paths"]) {
      for (const char* method : {"get", "post", "delete"}) {
        if (!item.contains(method)) continue;
        for (const auto& [status, response] : item[method]["responses"].items()) {
          look(status, response);
        }
      }
    }
    EXPECT_TRUE(found) << Name(row.code);
  }
}

TEST(OpenApi, NamesTheProblemsThatSayWhenToAskAgain) {
  const std::string text = Document()["components"]["headers"]["Retry-After"]["description"];
  for (const ErrorRow& row : ErrorTable()) {
    const bool named = text.find(Name(row.code)) != std::string::npos;
    EXPECT_EQ(named, row.retry_after_s > 0) << Name(row.code);
    EXPECT_TRUE(row.status != 503 || named) << Name(row.code);
  }
}

TEST(OpenApi, HasAnExampleOfARequestForEveryOperationAndATag) {
  std::set<std::string> tags;
  for (const json& tag : Document()["tags"]) tags.insert(tag["name"]);
  for (const auto& [path, item] : Document()["paths"].items()) {
    for (const char* method : {"get", "post", "delete"}) {
      if (!item.contains(method)) continue;
      EXPECT_GE(At(item[method], "x-codeSamples").size(), 1u) << method << path;
      EXPECT_EQ(At(item[method], "tags").size(), 1u) << method << path;
      for (const json& tag : item[method]["tags"]) EXPECT_TRUE(tags.contains(tag)) << tag;
    }
  }
}

// Generators make a file or a blob of a body with this schema, and drop one without a schema.
TEST(OpenApi, GivesEveryBodyASchemaAndBytesTheFormatBinary) {
  int binary = 0;
  ForEachValue(Document(), [&](const json& value) {
    if (!value.is_object() || !value.contains("content")) return;
    for (const auto& [type, media] : value["content"].items()) {
      const bool is_text = type.starts_with("text/") || type.ends_with("json");
      ASSERT_TRUE(media.contains("schema")) << type;
      const json bytes = {{"type", "string"}, {"format", "binary"}};
      EXPECT_EQ(media["schema"] == bytes, !is_text) << type;
      binary += !is_text;
    }
  });
  EXPECT_GT(binary, 15);
}

TEST(OpenApi, SaysWhatEveryFieldMeans) {
  int fields = 0;
  ForEachValue(Document(), [&](const json& value) {
    if (!value.is_object() || !value.contains("properties")) return;
    for (const auto& [name, field] : value["properties"].items()) {
      if (!field.is_object()) continue;
      const std::string own = field.value("description", "");
      EXPECT_FALSE(own.empty() && Resolve(field).value("description", "").empty()) << name;
      ++fields;
    }
  });
  EXPECT_GT(fields, 150);
}

// A generator makes one of the two useless: what is required must be sent, and never has a default.
TEST(OpenApi, RequiresNoFieldThatHasADefault) {
  ForEachValue(Document(), [&](const json& value) {
    if (!value.is_object()) return;
    if (value.contains("in") && value.value("required", false)) {
      EXPECT_FALSE(value.contains("schema") && Resolve(value["schema"]).contains("default"))
          << value["name"];
    }
    if (!value.contains("properties")) return;
    // openapi-typescript requires these.
    for (const auto& [name, field] : value["properties"].items()) {
      EXPECT_FALSE(field.is_object() && field.contains("default")) << name;
    }
  });
}

// ---- Fields ----

void ExpectRange(const json& schema, const char* closed, const char* open_key, double limit,
                 double unbounded, bool open, std::string_view name) {
  if (limit == unbounded) {
    EXPECT_FALSE(schema.contains(closed) || schema.contains(open_key)) << name;
    return;
  }
  EXPECT_EQ(schema.value(open ? open_key : closed, std::nan("")), limit) << name;
  EXPECT_FALSE(schema.contains(open ? closed : open_key)) << name;
}

void ExpectRange(const json& schema, double min, double max, bool open_min, bool open_max,
                 std::string_view name) {
  ExpectRange(schema, "minimum", "exclusiveMinimum", min, std::numeric_limits<double>::lowest(),
              open_min, name);
  ExpectRange(schema, "maximum", "exclusiveMaximum", max, std::numeric_limits<double>::max(),
              open_max, name);
}

/// The schema among `oneOf` that has no words; checks that the words are there.
const json& WithoutWords(const json& schema, const json& words, std::string_view name) {
  if (words.empty()) return schema;
  EXPECT_EQ(Resolve(schema.at("oneOf").at(1))["enum"], words) << name;
  return Resolve(schema.at("oneOf").at(0));
}

void ExpectKind(const json& schema, const IntegerKind& kind, std::string_view name) {
  EXPECT_EQ(At(schema, "type"), "integer") << name;
  EXPECT_EQ(At(schema, "minimum"), kind.min) << name;
  EXPECT_EQ(At(schema, "maximum"), kind.max) << name;
}

void ExpectKind(const json& schema, const NumberKind& kind, std::string_view name) {
  json words = json::array();
  if (kind.or_infinity) words.push_back("inf");
  if (!kind.word.empty()) words.push_back(kind.word);
  const json& number = WithoutWords(schema, words, name);
  EXPECT_EQ(At(number, "type"), "number") << name;
  ExpectRange(number, kind.min, kind.max, kind.open_min, kind.open_max, name);
}

void ExpectKind(const json& schema, const VectorKind& kind, std::string_view name) {
  const json words = kind.word.empty() ? json::array() : json::array({kind.word});
  const json& vector = WithoutWords(schema, words, name);
  EXPECT_EQ(At(vector, "type"), "array") << name;
  EXPECT_EQ(At(vector, "minItems"), kind.count) << name;
  EXPECT_EQ(At(vector, "maxItems"), kind.count) << name;
  EXPECT_EQ(At(vector, "items")["type"], "number") << name;
  ExpectRange(At(vector, "items"), kind.min, kind.max, false, false, name);
}

void ExpectKind(const json& schema, const IntegersKind& kind, std::string_view name) {
  EXPECT_EQ(At(schema, "type"), "array") << name;
  EXPECT_EQ(At(schema, "minItems"), kind.count) << name;
  EXPECT_EQ(At(schema, "maxItems"), kind.count) << name;
  ExpectKind(At(schema, "items"), IntegerKind{kind.min, kind.max}, name);
}

void ExpectKind(const json& schema, const ChoiceKind& kind, std::string_view name) {
  EXPECT_EQ(At(schema, "enum"), json(std::vector(kind.names.begin(), kind.names.end()))) << name;
}

void ExpectKind(const json& schema, const ChoicesKind& kind, std::string_view name) {
  EXPECT_EQ(At(schema, "type"), "array") << name;
  EXPECT_EQ(At(schema, "minItems"), 1) << name;
  EXPECT_EQ(At(schema, "uniqueItems"), true) << name;
  ExpectKind(At(schema, "items"), ChoiceKind{kind.names}, name);
}

void ExpectKind(const json& schema, const BooleanKind&, std::string_view name) {
  EXPECT_EQ(At(schema, "type"), "boolean") << name;
}

void ExpectKind(const json& schema, const LightsKind& kind, std::string_view name) {
  EXPECT_EQ(At(schema, "type"), "array") << name;
  EXPECT_EQ(At(schema, "maxItems"), kind.max) << name;
}

void ExpectKind(const json& schema, const TextKind&, std::string_view name) {
  EXPECT_EQ(At(schema, "type"), "string") << name;
}

/// A schema's default as the text of a parameter.
std::string DefaultText(const json& value) {
  if (value.is_string()) return value;
  if (!value.is_array()) return value.dump();
  std::string text;
  for (const json& element : value) text += (text.empty() ? "" : ",") + DefaultText(element);
  return text;
}

/// `schema_of(name)` gives a field's schema and whether it is required, null where it is not
/// documented. Fields of a named schema have no `default`: openapi-typescript would require them.
template <class Request, class SchemaOf>
void ExpectFields(const FieldTable<Request>& table, const std::set<std::string>& documented,
                  const SchemaOf& schema_of, bool with_defaults = true) {
  std::set<std::string> names;
  for (const Field<Request>& field : table.fields) {
    const std::string name(field.name);
    names.insert(name);
    ASSERT_TRUE(documented.contains(name)) << name;
    const json schema = schema_of(name);
    std::visit([&](const auto& kind) { ExpectKind(schema, kind, name); }, field.kind);
    const auto value = field.get(Request{});
    if (!value || field.required || WriteText(field.kind, *value).empty() || !with_defaults) {
      EXPECT_FALSE(schema.contains("default")) << name;
    } else {
      ASSERT_TRUE(schema.contains("default")) << name;
      EXPECT_EQ(DefaultText(At(schema, "default")), WriteText(field.kind, *value)) << name;
    }
  }
  EXPECT_EQ(names, documented);
}

template <class Request>
void ExpectParameters(const char* path, const char* method, const FieldTable<Request>& table) {
  SCOPED_TRACE(std::string(method) + " " + path);
  std::map<std::string, json> parameters;
  std::set<std::string> names;
  for (const json& reference : Document()["paths"][path][method]["parameters"]) {
    const json& parameter = Resolve(reference);
    if (At(parameter, "in") != "query") continue;
    names.insert(At(parameter, "name"));
    parameters[At(parameter, "name")] = parameter;
  }
  ExpectFields(table, names, [&](const std::string& name) {
    const json& parameter = parameters.at(name);
    // A list of objects has no form as a parameter, except as JSON text.
    return Resolve(parameter.contains("schema")
                       ? parameter.at("schema")
                       : parameter.at("content").at("application/json").at("schema"));
  });
  for (const Field<Request>& field : table.fields) {
    const json& parameter = parameters[std::string(field.name)];
    EXPECT_EQ(parameter.value("required", false), field.required) << field.name;
    const bool list = std::holds_alternative<VectorKind>(field.kind) ||
                      std::holds_alternative<IntegersKind>(field.kind) ||
                      std::holds_alternative<ChoicesKind>(field.kind);
    EXPECT_EQ(parameter.value("explode", true), !list) << field.name << ": 1,2,3 is one value";
  }
}

TEST(OpenApi, DescribesTheParametersAsTheyAreRead) {
  const Limits limits;
  ExpectParameters("/v1/trees", "post", UploadFields(limits));
  ExpectParameters("/v1/trees", "get", ListFields());
  ExpectParameters("/v1/trees/{id}", "get", DescribeFields(limits));
  ExpectParameters("/v1/trees/{id}/cells", "get", CellsFields());
  ExpectParameters("/v1/trees/{id}/tradeoff", "post", MeasureFields(limits));
  ExpectParameters("/v1/trees/{id}/tradeoff", "get", DescribeFields(limits));
  ExpectParameters("/v1/trees/{id}/rays/closest", "post", ClosestFields(limits));
  ExpectParameters("/v1/trees/{id}/rays/any", "post", AnyFields(limits));
  ExpectParameters("/v1/trees/{id}/points/closest", "post", ClosestPointFields(limits));
  ExpectParameters("/v1/trees/{id}/points/signed-distance", "post", SideFields(limits));
  ExpectParameters("/v1/trees/{id}/points/inside", "post", SideFields(limits));
  ExpectParameters("/v1/trees/{id}/visibility", "post", VisibilityFields(limits));
  ExpectParameters("/v1/trees/{id}/rays/count", "post", CountFields(limits));
  ExpectParameters("/v1/trees/{id}/rays/all", "post", AllFields(limits));
  ExpectParameters("/v1/trees/{id}/render.png", "get", RenderFields(limits));
  ExpectParameters("/v1/trees/{id}/render.npy", "get", RenderFields(limits));
}

TEST(OpenApi, DescribesTheFieldsOfRendersAsTheyAreRead) {
  const json& schema = Document().at("components").at("schemas").at("RenderRequest");
  EXPECT_EQ(At(schema, "additionalProperties"), false);
  std::set<std::string> names;
  const json properties = At(schema, "properties");
  for (const auto& [name, property] : properties.items()) names.insert(name);
  ExpectFields(
      RenderFields(Limits{}), names,
      [&](const std::string& name) {
        json field = properties.at(name);
        // A schema that is named for many uses has the default of them all.
        if (field.contains("$ref")) (field = Resolve(field)).erase("default");
        return field;
      },
      false);
}

TEST(OpenApi, WhatWasUsedIsAnyPrecisionButAuto) {
  const json& used = Resolve(Document()["components"]["headers"]["Kdray-Precision"]["schema"]);
  EXPECT_EQ(Resolve(used.at("allOf").at(0))["enum"], json(kPrecisionNames));
  EXPECT_EQ(used.at("not"), (json{{"enum", {"auto"}}}));
}

}  // namespace
}  // namespace kdray::api
