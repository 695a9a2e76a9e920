// SPDX-License-Identifier: Apache-2.0
#include "api/json_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace kdray::api {
namespace {

using testing::HasSubstr;

constexpr std::size_t kDepth = 32;

Outcome<JsonNumber> ReadNumber(const std::string& text) {
  Outcome<JsonObject> object = ReadJsonObject("{\"n\":" + text + "}", kDepth);
  if (!object) return std::move(object).problem();
  return std::get<JsonNumber>((*object)[0].value.value);
}

TEST(JsonReader, KeepsMembersInTheirOrderWithTheirLines) {
  const auto object =
      ReadJsonObject("{\n\"b\": [1, \"x\", {\"c\": null}],\n\"a\": true,\n\n\"\": 5\n}", kDepth);
  ASSERT_TRUE(object) << object.problem().detail;
  ASSERT_EQ(object->size(), 3u);
  EXPECT_EQ((*object)[0].key, "b");
  EXPECT_EQ((*object)[0].value.line, 2u);
  EXPECT_EQ((*object)[1].key, "a");
  EXPECT_EQ((*object)[1].value.line, 3u);
  EXPECT_EQ((*object)[2].key, "");
  EXPECT_EQ((*object)[2].value.line, 5u);
  const auto& array = std::get<JsonArray>((*object)[0].value.value);
  ASSERT_EQ(array.size(), 3u);
  EXPECT_EQ(std::get<JsonNumber>(array[0].value).integer, 1);
  EXPECT_EQ(std::get<std::string>(array[1].value), "x");
  EXPECT_EQ(std::get<JsonObject>(array[2].value)[0].value.KindName(), "null");
  EXPECT_TRUE(std::get<bool>((*object)[1].value.value));
}

TEST(JsonReader, CallsANumberAnIntegerOnlyBeyondDoubt) {
  EXPECT_EQ(ReadNumber("7")->integer, 7);
  EXPECT_EQ(ReadNumber("7.0")->integer, 7);
  EXPECT_EQ(ReadNumber("7e2")->integer, 700);
  EXPECT_EQ(ReadNumber("-7")->integer, -7);
  EXPECT_EQ(ReadNumber("-0.0")->integer, 0);
  EXPECT_EQ(ReadNumber("1.9")->integer, std::nullopt);
  EXPECT_EQ(ReadNumber("1e-400")->integer, 0);
  EXPECT_EQ(ReadNumber("9007199254740993")->integer, 9007199254740993);
  EXPECT_EQ(ReadNumber("9007199254740993.0")->integer, std::nullopt) << "a double rounds it";
  EXPECT_EQ(ReadNumber("9007199254740991.0")->integer, 9007199254740991);
  EXPECT_EQ(ReadNumber("9223372036854775807")->integer, 9223372036854775807);
  EXPECT_EQ(ReadNumber("9223372036854775808")->integer, std::nullopt);
  EXPECT_EQ(ReadNumber("-9223372036854775808")->integer, std::numeric_limits<std::int64_t>::min());
  EXPECT_EQ(ReadNumber("1e39")->integer, std::nullopt);
}

// N24 of the catalogue.
TEST(JsonReader, N24ReadsNumbersToTheNearestDoubleOrRefusesThem) {
  EXPECT_EQ(ReadNumber("1e39")->value, 1e39);
  EXPECT_EQ(ReadNumber("1e-400")->value, 0);
  EXPECT_TRUE(std::signbit(ReadNumber("-0.0")->value));
  EXPECT_TRUE(std::signbit(ReadNumber("-0")->value));
  EXPECT_EQ(ReadNumber("9007199254740993")->value, 9007199254740992.0);
  for (const char* text : {"1e999", "-1e999"}) {
    const auto refused = ReadNumber(text);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.problem().code, ErrorCode::kInvalidJson);
    EXPECT_EQ(refused.problem().parameter, "/n");
  }
  const auto nested = ReadJsonObject("{\"a\":[0,{\"b\":[1,2,1e999]}]}", kDepth);
  EXPECT_EQ(nested.problem().parameter, "/a/1/b/2");
}

TEST(JsonReader, RefusesAKeyThatStandsTwiceInOneObject) {
  const auto twice = ReadJsonObject("{\"a\":{\"b\":1,\n\"b\":1}}", kDepth);
  ASSERT_FALSE(twice);
  EXPECT_EQ(twice.problem().code, ErrorCode::kInvalidJson);
  EXPECT_EQ(twice.problem().parameter, "/a/b");
  EXPECT_EQ(twice.problem().line, 2u);
  EXPECT_FALSE(ReadJsonObject("{\"a\":1,\"\\u0061\":2}", kDepth)) << "the same key, escaped";
  EXPECT_TRUE(ReadJsonObject("{\"a\":{\"b\":1},\"b\":{\"b\":1}}", kDepth));
}

TEST(JsonReader, RefusesWhatIsNoJsonObject) {
  for (const std::string_view text : {"",
                                      " \n",
                                      "[]",
                                      "null",
                                      "true",
                                      "1",
                                      "\"x\"",
                                      "{",
                                      "}",
                                      "{}}",
                                      "{} {}",
                                      "{\"a\":1,}",
                                      "{\"a\" 1}",
                                      "{a:1}",
                                      "{\"a\":01}",
                                      "{\"a\":+1}",
                                      "{\"a\":.5}",
                                      "{\"a\":1.}",
                                      "{\"a\":NaN}",
                                      "{\"a\":Infinity}",
                                      "{\"a\":0x1}",
                                      "{\"a\":'x'}",
                                      "{\"a\":\"\xff\"}",
                                      "{\"a\":\"\xc0\x80\"}",
                                      "{\"a\":\"\xed\xa0\x80\"}",
                                      "{\"a\":\"\\ud800\"}",
                                      "{\"a\":\"\n\"}",
                                      "{\"a\":\"\\x\"}",
                                      "{\"a\":1}//",
                                      "{/**/}",
                                      "\xff",
                                      "{\"a\":tru}"}) {
    const auto object = ReadJsonObject(text, kDepth);
    ASSERT_FALSE(object) << text;
    EXPECT_EQ(object.problem().code, ErrorCode::kInvalidJson) << text;
    EXPECT_THAT(object.problem().detail, testing::Not(HasSubstr("json.exception"))) << text;
  }
  EXPECT_FALSE(ReadJsonObject(std::string_view("{}\0", 3), kDepth));
  EXPECT_FALSE(ReadJsonObject(std::string_view("{\0}", 3), kDepth));
  EXPECT_FALSE(ReadJsonObject(std::string_view("\0", 1), kDepth));
}

TEST(JsonReader, SaysLineAndColumnOfWhatIsNoJson) {
  const auto object = ReadJsonObject("{\"width\": 3,\n  \"height\" 4}", kDepth);
  ASSERT_FALSE(object);
  EXPECT_EQ(object.problem().line, 2u);
  EXPECT_THAT(object.problem().detail, HasSubstr("line 2, column 12"));
}

TEST(JsonReader, RefusesDeepNesting) {
  const auto nested = [](std::size_t depth) {
    return "{\"a\":" + std::string(depth - 1, '[') + std::string(depth - 1, ']') + "}";
  };
  EXPECT_TRUE(ReadJsonObject(nested(kDepth), kDepth));
  const auto deep = ReadJsonObject(nested(kDepth + 1), kDepth);
  ASSERT_FALSE(deep);
  EXPECT_EQ(deep.problem().code, ErrorCode::kInvalidJson);
  EXPECT_THAT(deep.problem().detail, HasSubstr("deeper than 32"));
  EXPECT_FALSE(ReadJsonObject("{\"a\":" + std::string(1000000, '['), kDepth));
  std::string objects;
  for (int i = 0; i < 1000000; ++i) objects += "{\"a\":";
  EXPECT_FALSE(ReadJsonObject(objects, kDepth));
}

TEST(JsonReader, BoundsTheNumberOfValues) {
  const auto list = [](std::size_t n) {
    std::string text = "{\"a\":[0";
    for (std::size_t i = 1; i < n; ++i) text += ",0";
    return text + "]}";
  };
  // The object and the array are values too.
  EXPECT_TRUE(ReadJsonObject(list(kMaxJsonValues - 2), kDepth));
  const auto many = ReadJsonObject(list(kMaxJsonValues - 1), kDepth);
  ASSERT_FALSE(many);
  EXPECT_THAT(many.problem().detail, HasSubstr("more than 4096 values"));
}

}  // namespace
}  // namespace kdray::api
