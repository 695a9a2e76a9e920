// SPDX-License-Identifier: Apache-2.0
#include "api/json_batch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "api/json_rows.h"
#include "tests/support/ray_rows.h"
#include "tests/support/seed.h"

namespace kdray::api {
namespace {

using testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

using Rows = std::vector<test::RayRow<double>>;

Outcome<Rows> Read(std::string_view json, std::uint64_t max_rows = 100) {
  const Outcome<RayTable> table = ReadRayRows(json, 0.25, kInfinity, max_rows);
  if (!table) return table.problem();
  return test::RowsOf(*table);
}

/// The first number of a batch of one row.
Outcome<double> ReadNumber(const std::string& number) {
  const Outcome<Rows> rows = Read("{\"rays\":[[" + number + ",0,0,0,0,1]]}");
  if (!rows) return rows.problem();
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
    const test::RayRow<double>& row = (*rows)[i];
    const double read[6] = {row.ox, row.oy, row.oz, row.dx, row.dy, row.dz};
    ASSERT_EQ(std::memcmp(read, &numbers[6 * i], sizeof(read)), 0) << "row " << i;
  }
}

/// The rows by the fast reader; nullopt if it leaves the text to the other.
std::optional<Rows> ReadPlain(std::string_view json, const BatchWork& work = {}) {
  const auto table = ReadPlainRays(json, 0.25, kInfinity, 1 << 20, work);
  EXPECT_TRUE(table);
  if (!table || !*table) return std::nullopt;
  return test::RowsOf(**table);
}
/// The same text for the slow reader alone: the fast one does not take an escaped key.
std::string ForTheSlowReader(std::string json) {
  const std::size_t key = json.find("\"rays\"");
  return key == std::string::npos ? json : json.replace(key, 6, "\"r\\u0061ys\"");
}
bool SameBits(const Rows& a, const Rows& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0);
}

TEST(PlainRays, AreTheFormsThatProgramsWrite) {
  for (const char* text :
       {"{\"rays\":[[1,2,3,4,5,6]]}", "{\"rays\": [[1.0, 2.5e-05, -3, 4, 5, 6, 0.0, null]]}",
        "{\n  \"rays\": [\n    [\n      1,\n      2,\n      3,\n      4,\n      5,\n      6\n    "
        "]\n  ]\n}\n",
        " { \"rays\" : [ ] } ",
        "{\"rays\":[[0,-0.0,1E+5,4e0,1e-400,6 ] ,\t[1,2,3,4,5,6,7,8]]}\r\n"}) {
    const auto rows = ReadPlain(text);
    ASSERT_TRUE(rows) << text;
    const auto slow = Read(ForTheSlowReader(text));
    ASSERT_TRUE(slow) << text;
    EXPECT_TRUE(SameBits(*rows, *slow)) << text;
  }
}

TEST(PlainRays, LeaveEverythingElseToTheOtherReader) {
  const std::string blanks(5000, ' '), digits(2000, '1');
  for (const std::string& text :
       {std::string(),
        std::string("{"),
        std::string("[[1,2,3,4,5,6]]"),
        std::string("{\"rays\":[}"),
        std::string("{\"rays\":[]]}"),
        std::string("{\"rays\":[[1,2,3,4,5,6]}"),
        std::string("{\"rays\":[[1,2,3,4,5,6],]}"),
        std::string("{\"rays\":[,[1,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[1,2,3,4,5]]}"),
        std::string("{\"rays\":[[1,2,3,4,5,6,7]]}"),
        std::string("{\"rays\":[[1,2,3,4,5,6,7,8,9]]}"),
        std::string("{\"rays\":[[01,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[1.,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[.5,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[+1,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[1e,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[-,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[1e999,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[NaN,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[inf,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[null,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[1,2,3,4,5,6,7,nul]]}"),
        std::string("{\"rays\":[[1 2,3,4,5,6]]}"),
        std::string("{\"rays\":[[]]}"),
        std::string("{\"rays\":[[1,2,3,4,5,6]],\"rays\":[[1,2,3,4,5,6]]}"),
        std::string("{\"rays\":[[1,2,3,4,5,\"]\"]]}"),
        "{\"rays\":[[1,2,3," + blanks + "4,5,6]]}",
        "{\"rays\":[[1,2,3,4,5," + digits + "]]}"}) {
    EXPECT_FALSE(ReadPlain(text)) << text.substr(0, 100);
  }
}

TEST(PlainRays, NeverTakeWhatTheOtherReaderRefuses) {
  auto random = test::RandomEngine(1005);
  constexpr std::string_view kCharacters = "0123456789.-+eE,[]{} \"nul\n:rays\0x";
  const std::string good =
      "{\"rays\": [[1.5,-2e3,0.1,4,5e-1,6], [0,0,0,0,0,1,0,null],\n[10,20,30,40,50,60,7,8]]}";
  int taken = 0;
  for (int i = 0; i < 60000; ++i) {
    std::string text = good;
    for (int edits = 1 + static_cast<int>(random() % 2); edits > 0; --edits) {
      const std::size_t at = random() % text.size();
      const char c = kCharacters[random() % kCharacters.size()];
      switch (random() % 3) {
        case 0:
          text[at] = c;
          break;
        case 1:
          text.insert(at, 1, c);
          break;
        default:
          text.erase(at, 1);
      }
    }
    const auto rows = ReadPlain(text);
    if (!rows) continue;
    ++taken;
    const auto slow = Read(ForTheSlowReader(text));
    ASSERT_TRUE(slow) << text;
    ASSERT_TRUE(SameBits(*rows, *slow)) << text;
  }
  EXPECT_GT(taken, 5000);
}

TEST(PlainRays, AreTheSameInManyPartsAndOnManyThreads) {
  std::string text = "{\"rays\":[";
  for (int i = 0; i < 40000; ++i) {
    text += (i == 0       ? "["
             : i % 7 == 0 ? " ,\n["
                          : ",[") +
            std::to_string(i) + ",0.25,-1e-3,1,0,0" + (i % 3 == 0 ? ",0.5,null]" : "]");
  }
  text += "]}";
  std::size_t most_parts = 0;
  const BatchWork work{.should_stop = {},
                       .run =
                           [&](std::size_t count, const std::function<void(std::size_t)>& piece) {
                             most_parts = std::max(most_parts, count);
                             std::vector<std::thread> threads;
                             for (std::size_t i = count; i-- > 0;) threads.emplace_back(piece, i);
                             for (std::thread& thread : threads) thread.join();
                           },
                       .charge = {}};
  const auto rows = ReadPlain(text, work);
  ASSERT_TRUE(rows);
  EXPECT_GT(most_parts, 5u);
  EXPECT_TRUE(SameBits(*rows, *Read(ForTheSlowReader(text), 40000)));
}

TEST(PlainRays, ChargeTheirMemoryBeforeTheyTakeIt) {
  std::uint64_t charged = 0;
  const auto charge = [&](std::uint64_t bytes) -> Check {
    charged += bytes;
    return Problem{ErrorCode::kMemoryFull, "no"};
  };
  const auto refused = ReadRayRows("{\"rays\":[[1,2,3,4,5,6],[1,2,3,4,5,6]]}", 0, 1, 10,
                                   {.should_stop = {}, .run = {}, .charge = charge});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.problem().code, ErrorCode::kMemoryFull);
  EXPECT_EQ(charged, 2u * 8 * sizeof(double));
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

TEST(RayRowsFromJson, NamesItsFormsToABodyThatIsNoJsonAtAll) {
  using std::string_literals::operator""s;
  for (const std::string& body : {"rays=1"s, "\0\0\x80\x3f"s, "\x80\4\x95\0"s}) {
    EXPECT_THAT(Read(body).problem().detail, HasSubstr("a .npy file (numpy.save)")) << body;
  }
  for (const std::string& body : {"{\"rays\":[[NaN]]}"s, "{\"rays\":[]\0}"s}) {
    EXPECT_THAT(Read(body).problem().detail, testing::Not(HasSubstr("npy"))) << body;
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
