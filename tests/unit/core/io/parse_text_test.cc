// SPDX-License-Identifier: Apache-2.0
#include "core/io/parse_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <charconv>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "core/io/mesh_error.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

using testing::ElementsAre;

// The words of all lines with their line numbers, as "line:word".
std::vector<std::string> Walk(std::string_view text, TextCursor::Syntax syntax = {}) {
  std::vector<std::string> words;
  TextCursor cursor(text, syntax);
  while (cursor.FindLineWithWords()) {
    for (;;) {
      const std::string_view word = cursor.NextWord();
      if (word.empty()) break;
      words.push_back(std::to_string(cursor.line()) + ":" + std::string(word));
    }
    cursor.NextLine();
  }
  EXPECT_TRUE(cursor.AtEnd());
  return words;
}

TEST(TextCursor, WalksByWordsAndLinesWithAnyLineEnd) {
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    const std::string text = "a\tb " + end + end + " \t" + end + "c" + end;
    EXPECT_THAT(Walk(text), ElementsAre("1:a", "1:b", "4:c"));
    EXPECT_THAT(Walk(text + "d"), ElementsAre("1:a", "1:b", "4:c", "5:d"));
  }
  EXPECT_THAT(Walk("a\rb\nc\r\nd"), ElementsAre("1:a", "2:b", "3:c", "4:d"));
  EXPECT_THAT(Walk(""), ElementsAre());
}

TEST(TextCursor, LeavesOutCommentsOnlyWhereTheFormatHasThem) {
  EXPECT_THAT(Walk("a #b c\n# d\ne#f", {.hash_comments = true}), ElementsAre("1:a", "3:e#f"));
  EXPECT_THAT(Walk("a #b"), ElementsAre("1:a", "1:#b"));
}

TEST(TextCursor, JoinsContinuedLinesOnlyWhereTheFormatHasThem) {
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    const std::string text = "a \\" + end + "b\\" + end + "c" + end + "d \\";
    EXPECT_THAT(Walk(text, {.continuation = true}), ElementsAre("1:a", "2:b", "3:c", "4:d"));
    TextCursor cursor(text, {.continuation = true});
    cursor.NextLine();
    EXPECT_EQ(cursor.NextWord(), "d");
    EXPECT_EQ(cursor.line(), 4u);
  }
  EXPECT_THAT(Walk("a \\\nb"), ElementsAre("1:a", "1:\\", "2:b"));
  EXPECT_THAT(Walk("a\\b \\ c\n", {.continuation = true}), ElementsAre("1:a\\b", "1:\\", "1:c"));
}

TEST(TextCursor, DoesNotContinueAComment) {
  TextCursor cursor("# C:\\dir\\\na", {.hash_comments = true, .continuation = true});
  cursor.NextLine();
  EXPECT_EQ(cursor.NextWord(), "a");
}

TEST(TextCursor, SkipsTheRestOfALine) {
  TextCursor cursor("a b c\nd", {}, 10);
  EXPECT_EQ(cursor.NextWord(), "a");
  cursor.NextLine();
  EXPECT_EQ(cursor.line(), 11u);
  EXPECT_EQ(cursor.remaining(), 1u);
  EXPECT_EQ(cursor.NextWord(), "d");
  EXPECT_EQ(cursor.NextWord(), "");
  cursor.NextLine();
  EXPECT_TRUE(cursor.AtEnd());
}

TEST(ParseNumber, ReadsWhatIsANumber) {
  struct Case {
    const char* word;
    double value;
  };
  for (const Case& c :
       {Case{"0", 0}, Case{"-0", -0.0}, Case{"+1", 1}, Case{"5.", 5}, Case{".8e-1", 0.08},
        Case{"-.7e+2", -70}, Case{".8e-001", 0.08}, Case{"1E5", 1e5}, Case{"00012", 12},
        Case{"1e39", 1e39}, Case{"1.7976931348623157e308", 1.7976931348623157e308},
        Case{"4.9e-324", 4.9e-324}, Case{"1e-400", 0}, Case{"-1e-400", -0.0},
        Case{"0.0000001e-330", 0}, Case{"1e-99999999999999999999", 0}, Case{"0e99999", 0},
        Case{"12345678901234567890", 12345678901234567890.0}}) {
    const std::optional<double> value = ParseNumber(c.word);
    ASSERT_TRUE(value.has_value()) << c.word;
    EXPECT_EQ(*value, c.value) << c.word;
    EXPECT_EQ(std::signbit(*value), std::signbit(c.value)) << c.word;
  }
}

TEST(ParseNumber, RefusesWhatIsNotAndSaysWhy) {
  struct Case {
    const char* word;
    const char* why;
  };
  for (const Case& c :
       {Case{"", "a number is missing"},
        Case{"abc", "'abc' is not a number"},
        Case{"-", "'-' is not a number"},
        Case{".", "'.' is not a number"},
        Case{"+-1", "'+-1' is not a number"},
        Case{"++1", "'++1' is not a number"},
        Case{"1e", "'1e' is not a number"},
        Case{"1e+", "'1e+' is not a number"},
        Case{"3.1+e2", "'3.1+e2' is not a number"},
        Case{"1,5", "'1,5' is not a number"},
        Case{"0x10", "'0x10' is not a number"},
        Case{"1.#IND", "'1.#IND' is not a number"},
        Case{"-1.#QNAN", "'-1.#QNAN' is not a number"},
        Case{"1.2.3", "'1.2.3' is not a number"},
        Case{"nan", "'nan' is not a finite number"},
        Case{"-inf", "'-inf' is not a finite number"},
        Case{"+INF", "'+INF' is not a finite number"},
        Case{"infinity", "'infinity' is not a finite number"},
        Case{"1e400", "'1e400' is beyond the range of double"},
        Case{"-1e309", "'-1e309' is beyond the range of double"},
        Case{"0.001e400", "'0.001e400' is beyond the range of double"},
        Case{"1e99999999999999999999", "'1e99999999999999999999' is beyond the range of double"}}) {
    EXPECT_FALSE(ParseNumber(c.word).has_value()) << c.word;
    EXPECT_EQ(WhyNotNumber(c.word), c.why);
  }
}

TEST(ParseNumber, ReturnsEveryDoubleThatWasPrinted) {
  std::mt19937_64 random = test::RandomEngine(30);
  for (int i = 0; i < 100000; ++i) {
    const auto value = std::bit_cast<double>(random());
    if (!std::isfinite(value)) continue;
    char text[64];
    const auto end = std::to_chars(text, text + sizeof text, value).ptr;
    ASSERT_EQ(ParseNumber(std::string_view(text, end)), value);
    const int length = std::snprintf(text, sizeof text, "%.17g", value);
    ASSERT_EQ(ParseNumber(std::string_view(text, static_cast<std::size_t>(length))), value);
  }
}

TEST(ParseInteger, TakesWholeNumbersOf64BitsOnly) {
  EXPECT_EQ(ParseInteger("42"), 42);
  EXPECT_EQ(ParseInteger("+42"), 42);
  EXPECT_EQ(ParseInteger("-9223372036854775808"), std::numeric_limits<std::int64_t>::min());
  for (const char* word : {"", "1.0", "0x1", "1e3", "9223372036854775808", "+-1", "1 "}) {
    EXPECT_FALSE(ParseInteger(word).has_value()) << word;
  }
  EXPECT_EQ(WhyNotInteger("1.0"), "'1.0' is not an integer of 64 bits");
  EXPECT_EQ(WhyNotInteger(""), "an integer is missing");
}

TEST(Quoted, IsPrintableAndShortWhateverTheFileHolds) {
  EXPECT_EQ(Quoted("abc"), "'abc'");
  EXPECT_EQ(Quoted(std::string_view("a\0\xff\n", 4)), "'a\\x00\\xff\\x0a'");
  EXPECT_EQ(Quoted(std::string(1000, 'x')), "'" + std::string(40, 'x') + "...'");
}

TEST(EqualsIgnoringCase, ComparesAsciiLetters) {
  EXPECT_TRUE(EqualsIgnoringCase("SoLiD", "solid"));
  EXPECT_FALSE(EqualsIgnoringCase("solids", "solid"));
  EXPECT_FALSE(EqualsIgnoringCase("soli", "solid"));
}

}  // namespace
}  // namespace kdray::core
