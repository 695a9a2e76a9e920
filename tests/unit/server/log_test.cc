#include "server/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

namespace kdray::server {
namespace {

using nlohmann::json;

TEST(Log, MakesOneJsonObjectALine) {
  const std::string line = FormatLogLine(
      LogLevel::kWarning, "request",
      {{"text", "a"}, {"count", std::uint64_t{7}}, {"ms", 1.25}, {"flag", true}, {"empty", ""}});
  const json object = json::parse(line);
  EXPECT_EQ(object.at("level"), "warning");
  EXPECT_EQ(object.at("event"), "request");
  EXPECT_EQ(object.at("text"), "a");
  EXPECT_EQ(object.at("count"), 7);
  EXPECT_EQ(object.at("ms"), 1.25);
  EXPECT_EQ(object.at("flag"), true);
  EXPECT_FALSE(object.contains("empty"));
  EXPECT_THAT(object.at("time").get<std::string>(),
              testing::MatchesRegex("....-..-..T..:..:..\\....Z"));
}

TEST(Log, EscapesWhateverAClientSends) {
  std::string bytes;
  for (int c = 0; c < 256; ++c) bytes += static_cast<char>(c);
  bytes += "\",\"level\":\"forged\"}\n{";
  const std::string line = FormatLogLine(LogLevel::kInfo, "request", {{"path", bytes}});
  EXPECT_EQ(line.find('\n'), std::string::npos);
  for (const char c : line) EXPECT_TRUE(c >= ' ' && c < '\x7f');
  const json object = json::parse(line);
  EXPECT_EQ(object.at("level"), "info");
  EXPECT_EQ(object.size(), 4U);
}

TEST(Log, WritesNoNumberThatJsonHasNot) {
  const json object = json::parse(
      FormatLogLine(LogLevel::kError, "x",
                    {{"a", std::numeric_limits<double>::infinity()}, {"b", std::nan("")}}));
  EXPECT_TRUE(object.at("a").is_null());
  EXPECT_TRUE(object.at("b").is_null());
}

TEST(Log, KeepsLinesOfManyThreadsApart) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  {
    const Log log(ends[1]);
    std::vector<std::jthread> threads;
    for (int i = 0; i < 8; ++i) {
      threads.emplace_back([&log] {
        for (int j = 0; j < 20; ++j) log.Write(LogLevel::kInfo, "line", {{"text", "0123456789"}});
      });
    }
  }
  close(ends[1]);
  std::string text;
  char bytes[4096];
  for (ssize_t count = 0; (count = read(ends[0], bytes, sizeof(bytes))) > 0;) {
    text.append(bytes, static_cast<std::size_t>(count));
  }
  close(ends[0]);
  int lines = 0;
  for (std::size_t begin = 0; begin < text.size(); ++lines) {
    const std::size_t end = text.find('\n', begin);
    EXPECT_EQ(json::parse(text.substr(begin, end - begin)).at("text"), "0123456789");
    begin = end + 1;
  }
  EXPECT_EQ(lines, 160);
}

}  // namespace
}  // namespace kdray::server
