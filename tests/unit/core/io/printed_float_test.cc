// SPDX-License-Identifier: Apache-2.0
#include "core/io/printed_float.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

#include "core/io/parse_text.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

std::optional<float> Parse(const std::string& word) {
  return ParsePrintedFloat(word, ParseCoordinate(word).value());
}

// The definition, by the C library: a number with an exponent is printed with as many digits, one
// without with as many places after the point.
bool IsPrintedFloat(const std::string& word) {
  const float nearest = std::strtof(word.c_str(), nullptr);
  char printed[400];
  const std::size_t point = word.find('.');
  const std::size_t e = word.find('e');
  if (e == std::string::npos) {
    const std::size_t places = point == std::string::npos ? 0 : word.size() - point - 1;
    std::snprintf(printed, sizeof printed, "%.*f", static_cast<int>(places),
                  static_cast<double>(nearest));
  } else {
    const std::size_t places = point == std::string::npos ? 0 : e - point - 1;
    std::snprintf(printed, sizeof printed, "%.*e", static_cast<int>(places),
                  static_cast<double>(nearest));
  }
  return word == printed;
}

TEST(ParsePrintedFloat, TakesEveryFloatThatWasPrinted) {
  std::mt19937_64 random = test::RandomEngine(32);
  for (int i = 0; i < 20000; ++i) {
    const auto number = std::bit_cast<float>(static_cast<std::uint32_t>(random()));
    if (!std::isfinite(number)) continue;
    for (const int digits : {6, 8, 9, 12, 14, 15, 17, 20, 60}) {
      char word[200];
      std::snprintf(word, sizeof word, "%.*g", digits, static_cast<double>(number));
      const std::optional<float> read = Parse(word);
      ASSERT_TRUE(read.has_value()) << word;
      ASSERT_EQ(*read, std::strtof(word, nullptr)) << word;
      if (digits >= 9) {
        ASSERT_EQ(std::bit_cast<std::uint32_t>(*read), std::bit_cast<std::uint32_t>(number));
      }
    }
  }
}

TEST(ParsePrintedFloat, AgreesWithPrintingOnRandomDecimals) {
  std::mt19937_64 random = test::RandomEngine(33);
  int yes = 0;
  int no = 0;
  for (int i = 0; i < 100000; ++i) {
    char word[64];
    const int places = static_cast<int>(random() % 17);
    // Doubles, doubles near floats, and round numbers.
    double number = std::ldexp(static_cast<double>(random() >> 11), -53);
    if (i % 3 == 1) number = static_cast<double>(static_cast<float>(number)) + 1e-9 * number;
    if (i % 3 == 2) number = std::round(number * 1000) / 1000;
    const int exponent = static_cast<int>(random() % 12) - 6;
    number *= std::pow(10.0, exponent);
    std::snprintf(word, sizeof word, random() % 2 == 0 ? "%.*f" : "%.*e", places, number);
    if (std::strtod(word, nullptr) == 0) continue;
    ASSERT_EQ(Parse(word).has_value(), IsPrintedFloat(word)) << word;
    ++(IsPrintedFloat(word) ? yes : no);
  }
  EXPECT_GT(yes, 10000);
  EXPECT_GT(no, 10000);
}

TEST(ParsePrintedFloat, JudgesNumbersAtTheEdges) {
  for (const char* word :
       {"0",
        "-0",
        "0.000000000000000000000",
        "0e99",
        "1e10",
        "16777216",
        "3.40282e38",
        "1.17549435e-38",
        "1e-45",
        "1.4e-45",
        "0.1",
        "0.100000",
        "0.10000000149011612",
        "+0.5",
        "0.0000099999997",
        "9.9999997e-06",
        "0.000010000000",
        "nan",
        "-inf",
        "1.#QNAN",
        "0.5000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
        "0000000000000000000000000000000000000000000000000000"}) {
    EXPECT_TRUE(Parse(word).has_value()) << word;
  }
  for (const char* word :
       {"0.1000000000", "16777217", "3.5e38", "1e39", "1e400", "1e-50", "1e-400", "1.3e-45",
        "0.10000000149011613", "0.1000000014901161195", "1.0000000e-09",
        "0.5000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
        "0000000000000000000000000000000000000000000000000001"}) {
    EXPECT_FALSE(Parse(word).has_value()) << word;
  }
  EXPECT_TRUE(std::signbit(*Parse("-0.000")));
  // As a double this is halfway between two floats, of which the even one is not the nearest.
  EXPECT_EQ(Parse("1.00000005960464477539062500001"), std::nullopt);
}

}  // namespace
}  // namespace kdray::core
