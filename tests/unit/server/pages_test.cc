#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "api/errors.h"
#include "server/pages/contract_page.h"
#include "server/pages/html.h"

namespace kdray::server {
namespace {

using testing::HasSubstr;

TEST(Html, EscapesWhatHasAMeaning) {
  EXPECT_EQ(EscapeHtml("<a href=\"x\" title='y'>&"),
            "&lt;a href=&quot;x&quot; title=&#39;y&#39;&gt;&amp;");
}

TEST(ContractPage, ShowsEveryOperationWithItsParametersAndAnswers) {
  const std::string page = MakeContractPage(R"({
    "info": {"title": "T", "version": "7", "description": "One.\n\nTwo <b>."},
    "paths": {"/v1/x/{id}": {
      "parameters": [{"$ref": "#/components/parameters/Id"}],
      "get": {"summary": "Gets", "parameters": [
          {"name": "n", "in": "query", "description": "a number",
           "schema": {"type": "integer", "minimum": 0, "maximum": 9, "default": 3}}],
        "responses": {"200": {"description": "fine"}, "404": {"$ref": "#/components/responses/Gone"}}},
      "post": {"summary": "Posts", "requestBody": {"description": "a mesh",
        "content": {"application/octet-stream": {}}}}}},
    "components": {"parameters": {"Id": {"name": "id", "in": "path", "description": "which"}},
                   "responses": {"Gone": {"description": "gone"}}}})");
  for (const char* text :
       {"<h1>T 7</h1>", "<p>One.</p>", "<p>Two &lt;b&gt;.</p>", "GET /v1/x/{id}", "POST /v1/x/{id}",
        "Gets", "integer; from 0; to 9; default 3", "a number", "which", "fine", "gone", "a mesh",
        "application/octet-stream"}) {
    EXPECT_THAT(page, HasSubstr(text));
  }
}

TEST(ContractPage, ListsEveryProblem) {
  const std::string page = MakeContractPage(R"({"info": {}, "paths": {}})");
  for (const api::ErrorRow& row : api::ErrorTable()) {
    EXPECT_THAT(page, HasSubstr("/problems/" + std::string(api::Name(row.code))));
    EXPECT_THAT(page, HasSubstr(EscapeHtml(row.meaning)));
  }
}

TEST(ContractPage, NeedsNothingFromElsewhere) {
  const std::string page = MakeContractPage(R"({"info": {}, "paths": {}})");
  for (const char* text : {"<script", "<link", "<img", "src=", "http://", "https://", "@import"}) {
    EXPECT_EQ(page.find(text), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace kdray::server
