// SPDX-License-Identifier: Apache-2.0
#include "api/query_string.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace kdray::api {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

std::vector<std::pair<std::string, std::string>> Pairs(std::string_view query) {
  const auto parameters = ParseQuery(query);
  EXPECT_TRUE(parameters) << query << ": " << parameters.problem().detail;
  std::vector<std::pair<std::string, std::string>> pairs;
  for (const Parameter& p : *parameters) pairs.emplace_back(p.name, p.value);
  return pairs;
}

TEST(QueryString, IsSplitAndItsPercentSignsDecoded) {
  EXPECT_THAT(Pairs(""), IsEmpty());
  EXPECT_THAT(Pairs("a=1&b=2"), ElementsAre(Pair("a", "1"), Pair("b", "2")));
  EXPECT_THAT(Pairs("a=1%2C2%2c3"), ElementsAre(Pair("a", "1,2,3")));
  EXPECT_THAT(Pairs("a=1e+5&+b=%20+"), ElementsAre(Pair("a", "1e+5"), Pair("+b", " +")));
  EXPECT_THAT(Pairs("a=1e%2B5"), ElementsAre(Pair("a", "1e+5")));
  EXPECT_THAT(Pairs("a=b=c"), ElementsAre(Pair("a", "b=c")));
  EXPECT_THAT(Pairs("a&b="), ElementsAre(Pair("a", ""), Pair("b", "")));
  EXPECT_THAT(Pairs("&&a=1&"), ElementsAre(Pair("a", "1")));
  EXPECT_THAT(Pairs("=1"), ElementsAre(Pair("", "1")));
  EXPECT_THAT(Pairs("%61=%00"), ElementsAre(Pair("a", std::string(1, '\0'))));
}

TEST(QueryString, RefusesDamagedPercentSigns) {
  for (const std::string_view query :
       {"a=%", "a=%1", "a=%zz", "a=%1g", "a=%g1", "%=1", "a=1&b=%2", "a=% 1", "a=%-1", "a=%+1"}) {
    const auto parameters = ParseQuery(query);
    ASSERT_FALSE(parameters) << query;
    EXPECT_EQ(parameters.problem().code, ErrorCode::kInvalidParameter);
  }
}

TEST(QueryString, RefusesANameThatComesTwiceHoweverItIsWritten) {
  for (const std::string_view query : {"a=1&a=1", "a=1&%61=2", "a&b=1&a", "&=&="}) {
    const auto parameters = ParseQuery(query);
    ASSERT_FALSE(parameters) << query;
    EXPECT_THAT(parameters.problem().detail, testing::HasSubstr("twice"));
  }
}

}  // namespace
}  // namespace kdray::api
