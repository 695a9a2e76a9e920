// SPDX-License-Identifier: Apache-2.0
#include "api/json_value.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "tests/support/seed.h"

namespace kdray::api {
namespace {

using Library = nlohmann::ordered_json;

std::string Dumped(const Library& json) {
  return json.dump(-1, ' ', false, Library::error_handler_t::replace);
}

TEST(JsonValue, IsTheTextThatTheLibraryWrites) {
  EXPECT_EQ(JsonValue().text(), "null");
  EXPECT_EQ(JsonValue(true).text(), "true");
  EXPECT_EQ(JsonValue(std::numeric_limits<std::int64_t>::min()).text(), "-9223372036854775808");
  EXPECT_EQ(JsonValue(std::numeric_limits<std::uint64_t>::max()).text(), "18446744073709551615");
  EXPECT_EQ(JsonValue(std::optional<int>()).text(), "null");
  EXPECT_EQ(JsonValue(std::optional<int>(3)).text(), "3");
  const JsonValue object{{"b", 1}, {"a", {{"x", "y"}, {"z", 2.5}}}};
  EXPECT_EQ(object.text(), R"({"b":1,"a":{"x":"y","z":2.5}})");
  JsonValue array = JsonValue::Array(std::vector<int>{});
  EXPECT_EQ(array.text(), "[]");
  array.Append(object);
  array.Append(JsonValue());
  EXPECT_EQ(array.text(), "[" + object.text() + ",null]");
}

TEST(JsonValue, WritesNumbersAsTheLibraryDoes) {
  for (const double number : {0.0,
                              -0.0,
                              1.0,
                              -1.0,
                              0.5,
                              100.0,
                              1e14,
                              1e15,
                              1e16,
                              123456789012345.0,
                              1234567890123456.0,
                              1e-4,
                              1.5e-4,
                              1e-5,
                              0.1,
                              12.25,
                              1e300,
                              5e-324,
                              1.7976931348623157e308,
                              2.0 / 3,
                              std::nan(""),
                              std::numeric_limits<double>::infinity()}) {
    EXPECT_EQ(JsonValue(number).text(), Dumped(Library(number))) << number;
  }
  std::mt19937_64 random(test::Seed());
  std::uniform_real_distribution<double> exponent(-30, 30), mantissa(-10, 10);
  for (int i = 0; i < 10'000; ++i) {
    const double number = mantissa(random) * std::pow(10, std::round(exponent(random)));
    EXPECT_EQ(Library::parse(JsonValue(number).text()).get<double>(), number);
  }
}

TEST(JsonValue, EscapesAndReplacesAsTheLibraryDoes) {
  for (const std::string& text :
       {std::string("plain"), std::string("\"\\/\b\f\n\r\t"), std::string("a\0b\x01\x1f\x7f", 6),
        std::string("\xc3\xa4\xe2\x82\xac\xf0\x9f\x98\x80")}) {
    EXPECT_EQ(JsonValue(text).text(), Dumped(Library(text)));
  }
  // What is not UTF-8: stray, short, overlong, surrogates, beyond the last character.
  for (const char* text : {"\x80", "a\xffz", "\xc3", "\xc0\xaf", "\xe0\x80\x80", "\xed\xa0\x80",
                           "\xf4\x90\x80\x80", "\xf8\x88\x80\x80\x80", "\xe2\x82"}) {
    const std::string value = Library::parse(JsonValue(text).text());  // throws unless it is UTF-8
    EXPECT_NE(value.find("\xef\xbf\xbd"), std::string::npos);
  }
}

}  // namespace
}  // namespace kdray::api
