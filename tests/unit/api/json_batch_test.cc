#include "api/json_batch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>

#include "tests/support/seed.h"

namespace kdray::api {
namespace {

using testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Outcome<std::vector<RayRow<double>>> Read(std::string_view json, std::uint64_t max_rows = 100) {
  return ReadRayRows(json, 0.25, kInfinity, max_rows);
}

/// The first number of a batch of one row.
Outcome<double> ReadNumber(const std::string& number) {
  Outcome<std::vector<RayRow<double>>> rows = Read("{\"rays\":[[" + number + ",0,0,0,0,1]]}");
  if (!rows) return std::move(rows).problem();
  return (*rows)[0].ox;
}

TEST(RayRowsFromJson, MixesRowsOfSixAndEight) {
  const auto rows = Read("{\"rays\": [[1,2,3,4,5,6], [1,2,3,4,5,6,7,8],\n [1,2,3,4,5,6,7,null]]}");
  ASSERT_TRUE(rows) << rows.problem().detail;
  ASSERT_EQ(rows->size(), 3u);
  EXPECT_EQ((*rows)[0].t_min, 0.25);
  EXPECT_EQ((*rows)[0].t_max, kInfinity);
  EXPECT_EQ((*rows)[0].dx, 4);
  EXPECT_EQ((*rows)[1].t_min, 7);
  EXPECT_EQ((*rows)[1].t_max, 8);
  EXPECT_EQ((*rows)[2].t_max, kInfinity);
}

TEST(RayRowsFromJson, TakesABatchOfNoRows) {
  const auto rows = Read(" { \"rays\" : [ ] } \n");
  ASSERT_TRUE(rows);
  EXPECT_TRUE(rows->empty());
}

// N24 of the catalogue.
TEST(RayRowsFromJson, N24ReadsNumbersToTheNearestDoubleOrRefusesThem) {
  EXPECT_EQ(*ReadNumber("1e39"), 1e39);
  EXPECT_EQ(*ReadNumber("1.7976931348623157e308"), std::numeric_limits<double>::max());
  EXPECT_EQ(*ReadNumber("1e-400"), 0.0);
  EXPECT_EQ(*ReadNumber("5e-324"), std::numeric_limits<double>::denorm_min());
  EXPECT_EQ(*ReadNumber("9007199254740993"), 9007199254740992.0) << "2^53 + 1, ties to even";
  EXPECT_EQ(*ReadNumber("-9007199254740995"), -9007199254740996.0);
  EXPECT_EQ(*ReadNumber("123456789012345678901234567890"), 123456789012345678901234567890.0);
  EXPECT_EQ(*ReadNumber("0.1"), 0.1);
  EXPECT_TRUE(std::signbit(*ReadNumber("-0.0")));
  EXPECT_TRUE(std::signbit(*ReadNumber("-0")));
  EXPECT_TRUE(std::signbit(*ReadNumber("-1e-400")));
  EXPECT_FALSE(std::signbit(*ReadNumber("0")));

  for (const char* number : {"1e999", "-1e999", "1e309"}) {
    const auto refused = ReadNumber(number);
    ASSERT_FALSE(refused) << number;
    EXPECT_EQ(refused.problem().code, ErrorCode::kInvalidJson);
    EXPECT_EQ(refused.problem().parameter, "/rays/0/0");
    EXPECT_THAT(refused.problem().detail, HasSubstr("beyond the range of double"));
  }
  const auto duplicate = Read("{\"rays\":[],\"rays\":[]}");
  ASSERT_FALSE(duplicate);
  EXPECT_EQ(duplicate.problem().code, ErrorCode::kInvalidJson);
  EXPECT_EQ(duplicate.problem().parameter, "/rays");
  EXPECT_THAT(duplicate.problem().detail, HasSubstr("repeated"));
}

TEST(RayRowsFromJson, ReadsTheShortestTextOfAnyDoubleBack) {
  auto random = test::RandomEngine(1002);
  std::string json = "{\"rays\":[";
  std::vector<double> numbers;
  while (numbers.size() < 6 * 20000) {
    const std::uint64_t bits = random();
    double number = 0;
    std::memcpy(&number, &bits, sizeof(number));
    if (!std::isfinite(number)) continue;
    char text[32];
    const auto end = std::to_chars(text, text + sizeof(text), number);
    json += numbers.size() % 6 == 0 ? (numbers.empty() ? "[" : "],[") : ",";
    json.append(text, end.ptr);
    numbers.push_back(number);
  }
  json += "]]}";
  const auto rows = Read(json, 20000);
  ASSERT_TRUE(rows) << rows.problem().detail;
  for (std::size_t i = 0; i < rows->size(); ++i) {
    const RayRow<double>& row = (*rows)[i];
    const double read[6] = {row.ox, row.oy, row.oz, row.dx, row.dy, row.dz};
    ASSERT_EQ(std::memcmp(read, &numbers[6 * i], sizeof(read)), 0) << "row " << i;
  }
}

TEST(RayRowsFromJson, RefusesWhatIsNoBatchAndNamesThePlace) {
  struct Case {
    std::string_view json;
    ErrorCode code;
    std::string_view pointer, detail;
  };
  constexpr auto kJson = ErrorCode::kInvalidJson;
  constexpr auto kParameter = ErrorCode::kInvalidParameter;
  const Case cases[] = {
      {"[]", kJson, "", "must be an object {\"rays\": [[…],…]}, not an array"},
      {"null", kJson, "", "not null"},
      {"17", kJson, "", "not a number"},
      {"\"rays\"", kJson, "", "not a string"},
      {"{}", kJson, "/rays", "missing"},
      {"{\"rays\":null}", kJson, "/rays", "not null"},
      {"{\"rays\":{}}", kJson, "/rays", "not an object"},
      {"{\"rays\":7}", kJson, "/rays", "not a number"},
      {"{\"rays\":[1,2,3,4,5,6]}", kJson, "/rays/0", "a row must be an array"},
      {"{\"rays\":[{}]}", kJson, "/rays/0", "not an object"},
      {"{\"rays\":[[]]}", kJson, "/rays/0", "has 0 numbers"},
      {"{\"rays\":[[1,2,3,4,5]]}", kJson, "/rays/0", "has 5 numbers; a row is 6"},
      {"{\"rays\":[[1,2,3,4,5,6],[1,2,3,4,5,6,7]]}", kJson, "/rays/1", "has 7 numbers"},
      {"{\"rays\":[[1,2,3,4,5,6,7,8,9]]}", kJson, "/rays/0", "more than 8 numbers"},
      {"{\"rays\":[[1,2,3,\"4\",5,6]]}", kJson, "/rays/0/3", "not a string"},
      {"{\"rays\":[[1,2,3,true,5,6]]}", kJson, "/rays/0/3", "not a boolean"},
      {"{\"rays\":[[1,2,3,[4],5,6]]}", kJson, "/rays/0/3", "not an array"},
      {"{\"rays\":[[1,2,3,{},5,6]]}", kJson, "/rays/0/3", "not an object"},
      {"{\"rays\":[[null,2,3,4,5,6]]}", kJson, "/rays/0/0", "null stands for t_max only"},
      {"{\"rays\":[[1,2,3,4,5,6,null,8]]}", kJson, "/rays/0/6", "null stands for t_max only"},
      {"{\"points\":[]}", kParameter, "/points", "just 'rays'"},
      {"{\"rays\":[],\"t_max\":1}", kParameter, "/t_max", "options are query parameters"},
      {"{\"a/b~c\":1}", kParameter, "/a~1b~0c", "no field 'a/b~c'"},
  };
  for (const Case& c : cases) {
    const auto rows = Read(c.json);
    ASSERT_FALSE(rows) << c.json;
    EXPECT_EQ(rows.problem().code, c.code) << c.json;
    EXPECT_EQ(rows.problem().parameter, c.pointer) << c.json;
    EXPECT_THAT(rows.problem().detail, HasSubstr(c.detail)) << c.json;
  }
}

TEST(RayRowsFromJson, RefusesWhatIsNoJson) {
  for (const std::string_view json : {"",
                                      " ",
                                      "{",
                                      "{\"rays\":[[1,2,3,4,5,6]]",
                                      "{\"rays\":[[1,2,3,4,5,6]]}x",
                                      "{\"rays\":[]}{}",
                                      "{\"rays\":[[1,2,3,4,5,6],]}",
                                      "{\"rays\":[[1 2,3,4,5,6]]}",
                                      "{rays:[]}",
                                      "{'rays':[]}",
                                      "{\"rays\":[[NaN,2,3,4,5,6]]}",
                                      "{\"rays\":[[Infinity,2,3,4,5,6]]}",
                                      "{\"rays\":[[.5,2,3,4,5,6]]}",
                                      "{\"rays\":[[1.,2,3,4,5,6]]}",
                                      "{\"rays\":[[01,2,3,4,5,6]]}",
                                      "{\"rays\":[[+1,2,3,4,5,6]]}",
                                      "{\"rays\":[[0x1,2,3,4,5,6]]}",
                                      "{\"ra\xffys\":[]}",
                                      "{\"rays\":[] /* none */}",
                                      "\x93NUMPY"}) {
    const auto rows = Read(json);
    ASSERT_FALSE(rows) << json;
    EXPECT_EQ(rows.problem().code, ErrorCode::kInvalidJson) << json;
    EXPECT_THAT(rows.problem().detail, testing::Not(HasSubstr("json.exception"))) << json;
    for (const char c : rows.problem().detail) EXPECT_GE(c, ' ') << rows.problem().detail;
  }
}

TEST(RayRowsFromJson, RefusesNulWhereTheParserWouldTakeItForTheEnd) {
  const std::string batch = "{\"rays\":[]}";
  ASSERT_TRUE(Read(batch));
  for (const std::string& json : {batch + '\0', batch + '\0' + batch, '\0' + batch}) {
    const auto rows = Read(json);
    ASSERT_FALSE(rows);
    EXPECT_THAT(rows.problem().detail, HasSubstr("is NUL"));
  }
}

TEST(RayRowsFromJson, NamesTheLine) {
  const auto line_of = [](std::string_view json) {
    const auto rows = Read(json);
    return rows ? 0 : rows.problem().line.value_or(0);
  };
  EXPECT_EQ(line_of("{\"rays\":[\n[1,2,3,4,5,6],\n[1,2,3,4,5]]}"), 3u);
  EXPECT_EQ(line_of("{\"rays\":\n7\n}"), 2u) << "a number's next character was read already";
  EXPECT_EQ(line_of("{\"rays\":[[1,\n2,\n\"x\"\n"), 3u);
  EXPECT_EQ(line_of("{\n\n\"rays\": [[1,2,3,4,5,6],\n]}"), 4u);
}

TEST(RayRowsFromJson, TakesAsManyRowsAsTheLimitAndNoMore) {
  EXPECT_TRUE(Read("{\"rays\":[[1,2,3,4,5,6],[1,2,3,4,5,6]]}", 2));
  const auto rows = Read("{\"rays\":[[1,2,3,4,5,6],[1,2,3,4,5,6],[", 2);
  ASSERT_FALSE(rows);
  EXPECT_EQ(rows.problem().code, ErrorCode::kTooManyRays);
  EXPECT_EQ(rows.problem().limit, 2);
}

TEST(RayRowsFromJson, EndsAtTheFirstBracketTooMany) {
  for (const char* start : {"", "{\"rays\":", "{\"rays\":[[1,", "{\"x\":"}) {
    const auto rows = Read(start + std::string(1000000, '['));
    ASSERT_FALSE(rows);
    EXPECT_LT(rows.problem().detail.size(), 400u);
  }
}

TEST(RayRowsFromJson, KeepsItsMessagesShortWhateverCame) {
  const std::string long_text(1000000, 'x');
  for (const std::string& json :
       {"{\"" + long_text + "\":1}", "{\"rays\":\"" + long_text, "{\"rays\":[[" + long_text,
        "{\"rays\":[[1e" + std::string(1000000, '9') + ",1]]}"}) {
    const auto rows = Read(json);
    ASSERT_FALSE(rows);
    EXPECT_LT(rows.problem().detail.size() + rows.problem().parameter.value_or("").size(), 500u);
  }
}

}  // namespace
}  // namespace kdray::api
