// SPDX-License-Identifier: Apache-2.0
#include "kdray/document.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace kdray::client {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(Document, RefusesWhatIsNotJson) {
  for (const char* text : {"", "{", "{} {}", "nan", "\"\xff\"", "<html>"})
    EXPECT_FALSE(Document::Parse(text)) << text;
}

TEST(Document, ReadsEveryKind) {
  const Document document =
      Document::Parse(R"({"text": "é", "number": -1.5, "count": 18446744073709551615,
                          "flag": true, "list": [1, "x", 2.5], "object": {"inner": 7}})")
          .value();
  EXPECT_TRUE(document.IsObject());
  EXPECT_EQ(document["text"].Text(), "é");
  EXPECT_EQ(document["number"].Number(), -1.5);
  EXPECT_EQ(document["count"].Count(), 18446744073709551615u);
  EXPECT_EQ(document["flag"].Flag(), true);
  EXPECT_THAT(document["list"].Numbers(), ElementsAre(1, 2.5));
  EXPECT_EQ(document["list"].Items().size(), 3u);
  EXPECT_EQ(document["object"]["inner"].Count(), 7u);
}

TEST(Document, ReadsAMissingMemberAndAnotherKindAsEmpty) {
  const Document document =
      Document::Parse(R"({"null": null, "text": "12", "negative": -1, "list": [], "flag": 1})")
          .value();
  EXPECT_FALSE(document["absent"]["deeper"].Text());
  for (const char* name : {"absent", "null", "list"}) {
    EXPECT_FALSE(document[name].IsObject()) << name;
    EXPECT_FALSE(document[name].Text()) << name;
    EXPECT_FALSE(document[name].Number()) << name;
    EXPECT_FALSE(document[name].Count()) << name;
    EXPECT_FALSE(document[name].Flag()) << name;
    EXPECT_THAT(document[name].Items(), IsEmpty()) << name;
  }
  EXPECT_FALSE(document["text"].Number());
  EXPECT_FALSE(document["text"]["member"].Text());
  EXPECT_FALSE(document["negative"].Count());
  EXPECT_FALSE(document["flag"].Flag());
  EXPECT_FALSE(Document().IsObject());
}

TEST(Document, OutlivesTheAnswerThatItIsAPartOf) {
  Document inner;
  {
    const Document answer = Document::Parse(R"({"trees": [{"id": "a"}, {"id": "b"}]})").value();
    inner = answer["trees"].Items().at(1)["id"];
  }
  EXPECT_EQ(inner.Text(), "b");
}

TEST(Document, WritesWhatItHasRead) {
  const Document document = Document::Parse(R"({"a":[1,2],"b":{}})").value();
  EXPECT_EQ(document.Indented(), "{\n  \"a\": [\n    1,\n    2\n  ],\n  \"b\": {}\n}");
  EXPECT_EQ(Document::ArrayOf({document["b"], document["a"]}).Indented(),
            "[\n  {},\n  [\n    1,\n    2\n  ]\n]");
  EXPECT_EQ(Document::ArrayOf({}).Indented(), "[]");
}

}  // namespace
}  // namespace kdray::client
