// SPDX-License-Identifier: Apache-2.0
#include "kdray/trace_context.h"

#include <gtest/gtest.h>

#include <string>

namespace kdray::client {
namespace {

const std::string kTrace(32, 'a'), kSpan(16, 'b');

TEST(Traceparent, HasTwoIdsAndFlags) {
  EXPECT_TRUE(IsTraceparent("00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"));
  EXPECT_TRUE(IsTraceparent("00-" + kTrace + "-" + kSpan + "-ff"));
}

TEST(Traceparent, IsNotAnythingElse) {
  for (const std::string& text : {
           std::string(),
           "00-" + kTrace + "-" + kSpan,
           "00-" + kTrace + "-" + kSpan + "-0",
           "00-" + kTrace + "-" + kSpan + "-011",
           "00-" + kTrace + "-" + kSpan + "-01-more",
           "01-" + kTrace + "-" + kSpan + "-01",
           "00-" + std::string(32, '0') + "-" + kSpan + "-01",
           "00-" + kTrace + "-" + std::string(16, '0') + "-01",
           "00-" + std::string(32, 'A') + "-" + kSpan + "-01",
           "00-" + std::string(32, 'g') + "-" + kSpan + "-01",
           "00_" + kTrace + "-" + kSpan + "-01",
           "00-" + kTrace + "_" + kSpan + "-01",
           "00-" + kTrace + "-" + kSpan + "_01",
           "00-" + kTrace + "-" + kSpan + "\r\n01",
       }) {
    EXPECT_FALSE(IsTraceparent(text)) << text;
  }
}

}  // namespace
}  // namespace kdray::client
