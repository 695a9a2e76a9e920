#include "clients/cpp/command/text.h"

#include <gtest/gtest.h>

#include "clients/cpp/command/answer_text.h"

namespace kdray::client {
namespace {

TEST(Text, GroupsDigitsByThree) {
  EXPECT_EQ(CountText(0), "0");
  EXPECT_EQ(CountText(999), "999");
  EXPECT_EQ(CountText(1000), "1,000");
  EXPECT_EQ(CountText(1234567), "1,234,567");
}

TEST(Text, ChoosesAUnitThatLeavesThreeDigitsAtMost) {
  EXPECT_EQ(ByteText(0), "0 B");
  EXPECT_EQ(ByteText(999), "999 B");
  EXPECT_EQ(ByteText(1000), "1.0 KiB");
  EXPECT_EQ(ByteText(3033195), "2.9 MiB");
  EXPECT_EQ(ByteText(200e6), "191 MiB");
  EXPECT_EQ(ByteText(5e15), "4547 TiB");  // the last unit takes what comes
}

TEST(Text, AlignsTheColumnsOfATable) {
  EXPECT_EQ(Table({{"ID", "N", "X"}, {"abc", "5", ""}, {"d", "1,234", "y"}}, "lrl"),
            "ID       N  X\n"
            "abc      5\n"
            "d    1,234  y\n");
  EXPECT_EQ(Table({}, ""), "");
}

TEST(AnswerText, SaysWhatTheHeadersSay) {
  HttpResponse response;
  EXPECT_EQ(AnswerText(response), "");
  response.headers = {{"kdray-precision", "watertight"},
                      {"server-timing", "queue;dur=0.1, trace;dur=23.5,encode;dur=4"},
                      {"kdray-invalid", "3"},
                      {"kdray-truncated", "0"}};
  EXPECT_EQ(AnswerText(response), "watertight precision, traced in 23.5 ms, 3 invalid rows");
}

TEST(AnswerText, FindsOneMetricOfServerTiming) {
  EXPECT_EQ(TimingOf("queue;dur=0.1, trace;dur=23", "trace"), "23");
  EXPECT_EQ(TimingOf("retrace;dur=1,trace;dur=2", "trace"), "2");
  EXPECT_EQ(TimingOf("queue;dur=0.1", "trace"), "");
  EXPECT_EQ(TimingOf("", "trace"), "");
}

}  // namespace
}  // namespace kdray::client
