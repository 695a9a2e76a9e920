// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/text.h"

#include <gtest/gtest.h>

#include "clients/cpp/command/answer_facts.h"
#include "clients/cpp/command/ending.h"
#include "clients/cpp/command/nearest_word.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

TEST(Text, GroupsDigitsByThree) {
  EXPECT_EQ(CountText(0), "0");
  EXPECT_EQ(CountText(999), "999");
  EXPECT_EQ(CountText(1000), "1,000");
  EXPECT_EQ(CountText(1234567), "1,234,567");
  EXPECT_EQ(CountedText(1, "invalid rows"), "1 invalid row");
  EXPECT_EQ(CountedText(1000, "rays"), "1,000 rays");
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

TEST(Text, SplitsATableThatIsWiderThanTheTerminal) {
  const std::vector<std::vector<std::string>> rows = {{"KEY", "ONE", "TWO"}, {"a", "1", "22"}};
  EXPECT_EQ(FittedTable(rows, "lrr", 0, 1), Table(rows, "lrr"));
  EXPECT_EQ(FittedTable(rows, "lrr", 13, 1), Table(rows, "lrr"));
  EXPECT_EQ(FittedTable(rows, "lrr", 12, 1),
            "KEY  ONE\n"
            "a      1\n"
            "\n"
            "KEY  TWO\n"
            "a     22\n");
  EXPECT_EQ(FittedTable(rows, "lrr", 1, 1), FittedTable(rows, "lrr", 12, 1));  // never less
}

TEST(Text, CountsCharactersAndNotBytes) {
  EXPECT_EQ(Table({{"\xC3\xA4\xC3\xA4", "x"}, {"abc", "y"}}, "ll"),
            "\xC3\xA4\xC3\xA4   x\nabc  y\n");
  EXPECT_EQ(Shortened("\xC3\xA4\xC3\xA4z", 2), "\xC3\xA4\xC3\xA4");
  EXPECT_EQ(Shortened("ab", 2), "ab");
}

TEST(Text, GivesDurationsInTheUnitThatAPersonWouldChoose) {
  EXPECT_EQ(DurationText(0), "0 ms");
  EXPECT_EQ(DurationText(0.4567), "0.46 ms");
  EXPECT_EQ(DurationText(12.5), "12.5 ms");
  EXPECT_EQ(DurationText(999.4), "999 ms");
  EXPECT_EQ(DurationText(999.6), "1.00 s");
  EXPECT_EQ(DurationText(10110), "10.1 s");
  EXPECT_EQ(DurationText(125000), "2 min 5 s");
  EXPECT_EQ(DurationText(3600000), "1 h 0 min");
  EXPECT_EQ(DurationText(86400000.0 * 3), "3 d 0 h");
  EXPECT_EQ(DurationText(-1), "?");
  EXPECT_EQ(DurationText(1e300), "more than 30 years");
}

TEST(Text, WritesNumbersWithoutExponentsWherePeopleDo) {
  EXPECT_EQ(NumberText(0.15556), "0.1556");
  EXPECT_EQ(NumberText(9999), "9999");
  EXPECT_EQ(NumberText(12345.6), "12,346");
  EXPECT_EQ(NumberText(-12345.6), "-12,346");
  EXPECT_EQ(NumberText(1e-7), "1e-07");
  EXPECT_EQ(ShortText(950), "950");
  EXPECT_EQ(ShortText(12345), "12.3 k");
  EXPECT_EQ(ShortText(999600), "1.00 M");
  EXPECT_EQ(ShortText(2.1e6), "2.10 M");
}

TEST(NearestWord, FindsWhatWasMeant) {
  const std::vector<std::string> words = {"upload", "render", "rays", "list"};
  EXPECT_EQ(NearestWord("uplaod", words), "upload");
  EXPECT_EQ(NearestWord("RENDER", words), "render");
  EXPECT_EQ(NearestWord("re", words), "render");
  EXPECT_EQ(NearestWord("ray", words), "rays");
  EXPECT_EQ(NearestWord("frobnicate", words), "");
  EXPECT_EQ(NearestWord("", words), "");
  EXPECT_EQ(NearestWord(std::string(100'000, 'u'), words), "");
  EXPECT_EQ(Suggestion("lst", words), "; did you mean 'list'?");
}

TEST(Ending, DecidesOrIsRefused) {
  EXPECT_EQ(TypeOfOutput("a.PNG", {"png", "npy"}), "png");
  EXPECT_EQ(TypeOfOutput("-", {"png", "npy"}), "png");
  EXPECT_EQ(TypeOfOutput("/dev/null", {"npy", "json"}), "npy");
  for (const char* path : {"a", "a.", "png", ".png", "a.jpg", "/dev/nowhere", "apng", "/tmp"}) {
    EXPECT_THROW(TypeOfOutput(path, {"png", "npy"}), UsageError) << path;
  }
}

TEST(AnswerFacts, SayWhatTheHeadersSay) {
  HttpResponse response;
  EXPECT_EQ(AnswerFacts::Of(response).Text(), "");
  response.headers = {{"kdray-precision", "watertight"},
                      {"server-timing", "queue;dur=0.1, trace;dur=23.5,encode;dur=4"},
                      {"kdray-invalid", "3"},
                      {"kdray-truncated", "0"}};
  AnswerFacts facts = AnswerFacts::Of(response);
  EXPECT_EQ(facts.Text(), "watertight precision, traced in 23.5 ms, 3 invalid rows");
  facts.Add(AnswerFacts::Of(response));
  EXPECT_EQ(facts.Text(), "watertight precision, traced in 47 ms, 6 invalid rows");
  response.headers = {{"server-timing", "trace;dur=10110"}, {"kdray-samples", "many"}};
  EXPECT_EQ(AnswerFacts::Of(response).Text(), "traced in 10.1 s");
}

TEST(AnswerFacts, FindOneMetricOfServerTiming) {
  EXPECT_EQ(TimingOf("queue;dur=0.1, trace;dur=23", "trace"), 23);
  EXPECT_EQ(TimingOf("retrace;dur=1,trace;dur=2", "trace"), 2);
  EXPECT_EQ(TimingOf("queue;dur=0.1", "trace"), std::nullopt);
  EXPECT_EQ(TimingOf("", "trace"), std::nullopt);
}

}  // namespace
}  // namespace kdray::client
