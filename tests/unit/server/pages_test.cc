#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <utility>

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

TEST(ContractPage, ShowsEveryOperationWithItsParametersAndAnswers) {
  const std::string page = MakeContractPage();
  const json document = json::parse(api::OpenApiJson());
  const auto resolve = [&](const json& value) -> const json& {
    if (!value.contains("$ref")) return value;
    return document.at(json::json_pointer(value["$ref"].get<std::string>().substr(1)));
  };
  const auto shows = [&](const std::string& text) {
    EXPECT_THAT(page, HasSubstr(EscapeHtml(text)));
  };
  EXPECT_THAT(page, HasSubstr("<h1>kdray 1</h1>"));
  for (const auto& [path, item] : document["paths"].items()) {
    for (const auto& [method, name] : {std::pair("get", "GET"), {"post", "POST"}}) {
      if (!item.contains(method)) continue;
      const json& operation = item[method];
      shows(std::string(name) + " " + path);
      shows(operation["summary"]);
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
  // A parameter with a range, one with names, and a body.
  for (const char* text :
       {"integer; from 0; to 60000; default 30000",
        "auto, fast, watertight, double, exact; default auto", "application/octet-stream"}) {
    shows(text);
  }
}

TEST(ContractPage, ListsEveryProblem) {
  const std::string page = MakeContractPage();
  for (const api::ErrorRow& row : api::ErrorTable()) {
    EXPECT_THAT(page, HasSubstr("/problems/" + std::string(api::Name(row.code))));
    EXPECT_THAT(page, HasSubstr(EscapeHtml(row.meaning)));
  }
}

TEST(ContractPage, NeedsNothingFromElsewhere) {
  const std::string page = MakeContractPage();
  for (const char* text : {"<script", "<link", "<img", "src=", "http://", "https://", "@import"}) {
    EXPECT_EQ(page.find(text), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace kdray::server
