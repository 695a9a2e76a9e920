// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "api/answer_codec.h"
#include "api/limits.h"
#include "api/request_codec.h"

namespace kdray::api {
namespace {

using nlohmann::json;

json Row(const TradeoffRow& row) {
  Tradeoff tradeoff;
  tradeoff.ready = true;
  tradeoff.results = {row};
  return json::parse(EncodeTradeoff(tradeoff)).at("results").at(0);
}

TEST(Tradeoffs, SayOnlyHowFarTheyAreWhileTheyAreMeasured) {
  Tradeoff tradeoff;
  tradeoff.progress = 0.25;
  tradeoff.results.resize(1);
  EXPECT_EQ(json::parse(EncodeTradeoff(tradeoff)),
            json({{"state", "measuring"}, {"progress", 0.25}}));
}

TEST(Tradeoffs, ShowEachZeroWithItsBoundAndNothingElseWithOne) {
  TradeoffRow row;
  row.leaks = ErrorRate{0, 300};
  row.missed_hits = {3, 300};
  const json json_row = Row(row);
  EXPECT_EQ(json_row.at("leaks"),
            json({{"count", 0}, {"rays", 300}, {"rate", 0.0}, {"below", 0.01}}));
  EXPECT_EQ(json_row.at("missed_hits"), json({{"count", 3}, {"rays", 300}, {"rate", 0.01}}));
  EXPECT_EQ(json_row.at("extra_hits").at("below"), 1.0) << "no ray says nothing";
}

TEST(Tradeoffs, HaveNullWhereThereIsNothingToSay) {
  const json row = Row({});
  EXPECT_TRUE(row.at("leaks").is_null());
  EXPECT_TRUE(row.at("t_error").at("bound").is_null());
}

TEST(Tradeoffs, WaitAsLongAsTheRequestSays) {
  EXPECT_EQ(DecodeMeasure("", Limits{})->wait_ms, 30000);
  EXPECT_EQ(DecodeMeasure("wait_ms=0", Limits{})->wait_ms, 0);
  EXPECT_EQ(DecodeMeasure("wait_ms=60000", Limits{})->wait_ms, 60000);
  for (const char* query : {"wait_ms=60001", "wait_ms=-1", "wait_ms=", "wait=1"}) {
    EXPECT_FALSE(DecodeMeasure(query, Limits{})) << query;
  }
}

}  // namespace
}  // namespace kdray::api
