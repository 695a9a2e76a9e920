// SPDX-License-Identifier: Apache-2.0
#include "server/log.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <ctime>
#include <future>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

/// A pipe, or another pair of connected ends.
class Ends {
 public:
  Ends() { EXPECT_EQ(pipe2(fds_, O_CLOEXEC), 0); }
  explicit Ends(int socket_kind) {
    EXPECT_EQ(socketpair(AF_UNIX, socket_kind | SOCK_CLOEXEC, 0, fds_), 0);
  }
  ~Ends() {
    CloseReader();
    CloseWriter();
  }
  Ends(const Ends&) = delete;
  Ends& operator=(const Ends&) = delete;

  int writer() const { return fds_[1]; }
  void CloseReader() { Close(0); }
  void CloseWriter() { Close(1); }
  /// Until nothing more is to come.
  std::string ReadAll() {
    std::string text;
    char bytes[4096];
    for (ssize_t count = 0; (count = read(fds_[0], bytes, sizeof(bytes))) > 0;) {
      text.append(bytes, static_cast<std::size_t>(count));
    }
    return text;
  }
  /// What comes within `time`, at most a few lines.
  std::string ReadSome(std::chrono::milliseconds time) {
    pollfd entry{.fd = fds_[0], .events = POLLIN, .revents = 0};
    if (poll(&entry, 1, static_cast<int>(time.count())) <= 0) return {};
    char bytes[4096];
    const ssize_t count = read(fds_[0], bytes, sizeof(bytes));
    return {bytes, static_cast<std::size_t>(std::max<ssize_t>(count, 0))};
  }
  /// What comes until `text` has been seen, or some seconds pass.
  std::string ReadUntil(const std::string& text) {
    std::string all;
    const auto deadline = Clock::now() + 10s;
    while (all.find(text) == std::string::npos && Clock::now() < deadline) all += ReadSome(100ms);
    return all;
  }
  /// Until not one byte more fits.
  void Fill() {
    const int flags = fcntl(writer(), F_GETFL);
    fcntl(writer(), F_SETFL, flags | O_NONBLOCK);
    while (write(writer(), "\n", 1) == 1) {
    }
    fcntl(writer(), F_SETFL, flags);
  }

 private:
  void Close(int end) {
    if (fds_[end] >= 0) close(fds_[end]);
    fds_[end] = -1;
  }
  int fds_[2] = {-1, -1};
};

std::vector<json> Lines(const std::string& text) {
  std::vector<json> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    if (line.empty()) continue;  // what Fill() wrote
    lines.push_back(json::parse(line, nullptr, false));
    EXPECT_FALSE(lines.back().is_discarded()) << line;
  }
  return lines;
}

double ProcessorSeconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

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

TEST(Log, KeepsLinesOfManyThreadsApartAndEachInOrder) {
  Ends pipe;
  auto text = std::async(std::launch::async, [&] { return pipe.ReadAll(); });
  {
    const Log log(pipe.writer());
    std::vector<std::jthread> threads;
    for (std::uint64_t i = 0; i < 8; ++i) {
      threads.emplace_back([&log, i] {
        for (std::uint64_t j = 0; j < 400; ++j) {
          log.Write(LogLevel::kInfo, "line", {{"thread", i}, {"number", j}});
        }
      });
    }
  }
  pipe.CloseWriter();
  std::vector<std::uint64_t> next(8, 0);
  for (const json& line : Lines(text.get())) {
    EXPECT_EQ(line.at("number"), next.at(line.at("thread"))++);
  }
  EXPECT_EQ(next, std::vector<std::uint64_t>(8, 400));
}

TEST(Log, KeepsLinesWholeThatAreLongerThanAPipeTakesAtOnce) {
  Ends pipe;
  auto text = std::async(std::launch::async, [&] { return pipe.ReadAll(); });
  {
    const Log log(pipe.writer());
    for (std::size_t i = 1; i <= 20; ++i) {
      log.Write(LogLevel::kInfo, "long", {{"text", std::string(i * 5000, 'x')}});
    }
  }
  pipe.CloseWriter();
  std::size_t number = 0;
  for (const json& line : Lines(text.get())) {
    EXPECT_EQ(line.at("text").get<std::string>().size(), ++number * 5000);
  }
  EXPECT_EQ(number, 20U);
}

TEST(Log, NeverWaitsForAReader) {
  for (const bool is_socket : {false, true}) {
    const auto ends = is_socket ? std::make_unique<Ends>(SOCK_STREAM) : std::make_unique<Ends>();
    ends->Fill();
    const auto start = Clock::now();
    {
      const Log log(ends->writer());
      std::vector<std::jthread> threads;
      for (int i = 0; i < 4; ++i) {
        threads.emplace_back([&log] {
          for (int j = 0; j < 5000; ++j) log.Write(LogLevel::kInfo, "line", {{"text", "a"}});
        });
      }
      threads.clear();
      EXPECT_GE(log.dropped(), 20'000 - Log::kMaxLines);
      EXPECT_LT(log.dropped(), 20'000U);
    }
    EXPECT_LT(Clock::now() - start, 2s);  // its end included
  }
}

TEST(Log, LeavesTheFlagsOfASharedDescriptorAlone) {
  Ends pipe;
  const int flags = fcntl(pipe.writer(), F_GETFL);
  const Log log(pipe.writer());
  log.Write(LogLevel::kInfo, "line", {});
  EXPECT_NE(pipe.ReadUntil("}\n"), "");
  EXPECT_EQ(fcntl(pipe.writer(), F_GETFL), flags);
}

TEST(Log, TellsHowManyLinesWereDroppedWhenItCanWriteAgain) {
  Ends pipe;
  pipe.Fill();
  std::string text;
  std::uint64_t written = 0;
  {
    const Log log(pipe.writer());
    const auto write = [&] { log.Write(LogLevel::kInfo, "line", {{"number", written++}}); };
    for (int round = 0; round < 3; ++round) {
      for (int i = 0; i < 6000; ++i) write();
      const std::size_t begin = text.size();
      const auto deadline = Clock::now() + 10s;
      while (text.find("log_dropped", begin) == std::string::npos && Clock::now() < deadline) {
        text += pipe.ReadSome(10ms);
        write();
      }
    }
    EXPECT_GT(log.dropped(), 0U);
    auto rest = std::async(std::launch::async, [&] { return pipe.ReadUntil("last"); });
    log.Write(LogLevel::kInfo, "last", {{"number", written++}});
    text += rest.get();
  }
  pipe.CloseWriter();
  text += pipe.ReadAll();
  std::uint64_t next = 0, dropped = 0, reports = 0;
  for (const json& line : Lines(text)) {
    if (line.at("event") == "log_dropped") {
      EXPECT_EQ(line.at("level"), "warning");
      ++reports;
      dropped += line.at("lines").get<std::uint64_t>();
      next += line.at("lines").get<std::uint64_t>();
      continue;
    }
    EXPECT_EQ(line.at("number"), next++);  // what is missing stood where the report stands
  }
  EXPECT_EQ(next, written);
  EXPECT_GE(reports, 3U);
  EXPECT_GT(dropped, 0U);
}

TEST(Log, HoldsNoMoreThanItSays) {
  Ends pipe;
  pipe.Fill();
  const Log log(pipe.writer());
  const std::string path(40'000, 'p');
  for (int i = 0; i < 1000; ++i) log.Write(LogLevel::kInfo, "line", {{"path", path}});
  EXPECT_GE(log.dropped(), 1000 - Log::kMaxBytes / 40'000 - 1);
}

TEST(Log, SurvivesAReaderThatHasGone) {
  const auto before = std::signal(SIGPIPE, SIG_IGN);
  for (const bool is_socket : {false, true}) {
    const auto ends = is_socket ? std::make_unique<Ends>(SOCK_STREAM) : std::make_unique<Ends>();
    const double seconds = ProcessorSeconds();
    {
      const Log log(ends->writer());
      log.Write(LogLevel::kInfo, "line", {});
      ends->ReadUntil("}\n");
      ends->CloseReader();
      for (int i = 0; i < 100; ++i) log.Write(LogLevel::kInfo, "line", {});
      EXPECT_TRUE(test::WaitUntil([&] { return log.dropped() == 100; })) << log.dropped();
      std::this_thread::sleep_for(300ms);  // real time: a writer that spins would use all of it
    }
    EXPECT_LT(ProcessorSeconds() - seconds, 0.2);
  }
  std::signal(SIGPIPE, before);
}

TEST(Log, AppendsWhereOthersWriteToTheSameFile) {
  const test::TemporaryFolder folder;
  const std::string path = (folder.path() / "log").string();
  const int fd = open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0600);
  ASSERT_GE(fd, 0);
  ASSERT_EQ(write(fd, "before\n", 7), 7);
  { Log(fd).Write(LogLevel::kInfo, "line", {}); }
  ASSERT_EQ(write(fd, "after\n", 6), 6);
  std::string text(1000, 0);
  text.resize(static_cast<std::size_t>(pread(fd, text.data(), text.size(), 0)));
  close(fd);
  EXPECT_THAT(text, testing::MatchesRegex("before\n\\{.*\\}\nafter\n"));
}

TEST(Log, WritesNothingWithoutADescriptor) {
  const Log log(-1);
  log.Write(LogLevel::kError, "line", {});
  EXPECT_EQ(log.dropped(), 0U);
}

TEST(Log, WritesTheLinesOfItsLevelAndAbove) {
  Ends ends;
  {
    const Log log(ends.writer(), LogLevel::kWarning);
    EXPECT_FALSE(log.Takes(LogLevel::kInfo));
    EXPECT_TRUE(log.Takes(LogLevel::kError));
    log.Write(LogLevel::kInfo, "one", {});
    log.Write(LogLevel::kWarning, "two", {});
    log.Write(LogLevel::kError, "three", {});
  }
  ends.CloseWriter();
  std::istringstream lines(ends.ReadAll());
  std::vector<std::string> events;
  for (std::string line; std::getline(lines, line);) {
    events.push_back(json::parse(line).at("event"));
  }
  EXPECT_EQ(events, (std::vector<std::string>{"two", "three"}));
}

}  // namespace
}  // namespace kdray::server
