// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "api/errors.h"
#include "api/openapi_document.h"
#include "server/pages/contract_page.h"
#include "server/pages/html.h"

namespace kdray::server {
namespace {

using nlohmann::json;
using testing::HasSubstr;

TEST(Html, EscapesWhatHasAMeaning) {
  EXPECT_EQ(EscapeHtml("<a href=\"x\" title='y'>&"),
            "&lt;a href=&quot;x&quot; title=&#39;y&#39;&gt;&amp;");
}

/// What a reader sees of a page: without its tags.
std::string TextOf(const std::string& page) {
  static const std::regex tag("<[^>]*>");
  return std::regex_replace(page, tag, "");
}

/// As the page shows a description, whose only markup are backticks.
std::string Shown(std::string text) {
  std::erase(text, '`');
  return EscapeHtml(text);
}

TEST(ContractPage, ShowsEveryOperationWithItsParametersAndAnswers) {
  const std::string page = TextOf(MakeContractPage());
  const json document = json::parse(api::OpenApiJson());
  const auto resolve = [&](const json& value) -> const json& {
    if (!value.contains("$ref")) return value;
    return document.at(json::json_pointer(value["$ref"].get<std::string>().substr(1)));
  };
  const auto shows = [&](const std::string& text) { EXPECT_THAT(page, HasSubstr(Shown(text))); };
  shows("kdray 1");
  for (const auto& [path, item] : document["paths"].items()) {
    for (const auto& [method, name] :
         {std::pair("get", "GET"), {"post", "POST"}, {"delete", "DELETE"}}) {
      if (!item.contains(method)) continue;
      const json& operation = item[method];
      shows(std::string(name) + " " + path);
      shows(operation["summary"]);
      for (const json& sample : operation["x-codeSamples"]) shows(sample["source"]);
      for (const json& reference : operation.value("parameters", json::array())) {
        const json& parameter = resolve(reference);
        shows(parameter["name"]);
        shows(parameter.value("description", ""));
        // A parameter of JSON text has `content` instead, and a description of its own.
        if (!parameter.contains("schema")) continue;
        shows(resolve(parameter["schema"]).value("description", ""));
      }
      for (const auto& [status, answer] : operation["responses"].items()) {
        shows(status);
        shows(resolve(answer)["description"]);
      }
    }
  }
  for (const auto& [name, header] : document["components"]["headers"].items()) {
    shows(name);
    shows(header["description"]);
  }
  // A parameter with a range, one with names, and a body.
  for (const char* text :
       {"integer; from 0; to 60000; default 30000",
        "auto, fast, watertight, double, exact; default auto", "application/octet-stream"}) {
    shows(text);
  }
}

/// The names of all properties of a schema and of those inside it, and their descriptions.
void CollectFields(const json& schema, std::vector<std::string>& texts) {
  const json properties = schema.value("properties", json::object());
  for (const auto& [name, field] : properties.items()) {
    texts.push_back(name);
    texts.push_back(field.value("description", ""));
    CollectFields(field, texts);
  }
}

TEST(ContractPage, ShowsEveryFieldOfEveryBody) {
  const std::string page = TextOf(MakeContractPage());
  const json document = json::parse(api::OpenApiJson());
  std::vector<std::string> texts;
  for (const json& schema : document["components"]["schemas"]) CollectFields(schema, texts);
  for (const json& item : document["paths"]) {
    for (const json& operation : item) {
      if (!operation.is_object()) continue;
      for (const json& answer : operation["responses"]) {
        for (const json& media : answer.value("content", json::object())) {
          CollectFields(media.value("schema", json::object()), texts);
        }
      }
    }
  }
  EXPECT_GT(texts.size(), 300u);
  for (const std::string& text : texts) EXPECT_THAT(page, HasSubstr(Shown(text)));
}

TEST(ContractPage, LinksOnlyToWhatItHas) {
  const std::string page = MakeContractPage();
  std::set<std::string> anchors;
  static const std::regex id("id=\"([^\"]*)\""), link("href=\"#([^\"]*)\"");
  for (std::sregex_iterator it(page.begin(), page.end(), id), end; it != end; ++it) {
    EXPECT_TRUE(anchors.insert((*it)[1]).second) << (*it)[1] << " is there twice";
  }
  int links = 0;
  for (std::sregex_iterator it(page.begin(), page.end(), link), end; it != end; ++it, ++links) {
    EXPECT_TRUE(anchors.contains((*it)[1])) << (*it)[1];
  }
  EXPECT_GT(links, 150);
}

TEST(ContractPage, ListsEveryProblem) {
  const std::string page = MakeContractPage();
  for (const api::ErrorRow& row : api::ErrorTable()) {
    EXPECT_THAT(page, HasSubstr("\"problems/" + std::string(api::Name(row.code))));
    EXPECT_THAT(page, HasSubstr(EscapeHtml(row.meaning)));
  }
}

TEST(ContractPage, NeedsNothingFromElsewhere) {
  const std::string page = MakeContractPage();
  for (const char* text : {"<script", "<link", "<img", "src=", "href=\"http", "url(", "@import"}) {
    EXPECT_EQ(page.find(text), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace kdray::server
