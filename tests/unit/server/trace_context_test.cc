// SPDX-License-Identifier: Apache-2.0
#include "server/http/trace_context.h"

#include <gtest/gtest.h>

#include <string>

namespace kdray::server {
namespace {

const std::string kTrace = "4bf92f3577b34da6a3ce929d0e0e4736", kParent = "00f067aa0ba902b7";

TEST(Traceparent, HasTheIdsOfTraceAndSpan) {
  const std::string value = "00-" + kTrace + "-" + kParent + "-01";
  const auto context = ParseTraceparent(value);
  ASSERT_TRUE(context);
  EXPECT_EQ(context->trace_id, kTrace);
  EXPECT_EQ(context->parent_id, kParent);
}

TEST(Traceparent, MayHaveFurtherFieldsInLaterVersions) {
  const std::string rest = "-" + kTrace + "-" + kParent + "-00";
  EXPECT_TRUE(ParseTraceparent("cc" + rest));
  EXPECT_TRUE(ParseTraceparent("cc" + rest + "-what-the-future-brings"));
  EXPECT_FALSE(ParseTraceparent("cc" + rest + "x"));
  EXPECT_FALSE(ParseTraceparent("00" + rest + "-what-the-future-brings"));
}

TEST(Traceparent, IsIgnoredWhenItIsInvalid) {
  const std::string zeros(32, '0');
  for (const std::string& value :
       {std::string(), std::string("00"), std::string(55, '-'),
        "ff-" + kTrace + "-" + kParent + "-01", "00-" + zeros + "-" + kParent + "-01",
        "00-" + kTrace + "-" + zeros.substr(16) + "-01", "00-" + kTrace + "-" + kParent + "-0",
        "00-" + kTrace + "-" + kParent + "-0g", "0x-" + kTrace + "-" + kParent + "-01",
        "00_" + kTrace + "-" + kParent + "-01",
        "00-4BF92F3577B34DA6A3CE929D0E0E4736-" + kParent + "-01",
        "00-" + kTrace.substr(1) + "\n-" + kParent + "-01"}) {
    EXPECT_FALSE(ParseTraceparent(value)) << value;
  }
}

}  // namespace
}  // namespace kdray::server
