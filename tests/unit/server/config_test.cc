// SPDX-License-Identifier: Apache-2.0
#include "server/config.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <vector>

namespace kdray::server {
namespace {

std::variant<Config, ConfigExit> Parse(const std::vector<const char*>& arguments) {
  std::vector<const char*> argv = {"kdrayd"};
  argv.insert(argv.end(), arguments.begin(), arguments.end());
  return ParseConfig(static_cast<int>(argv.size()), argv.data());
}

Config Accepted(const std::vector<const char*>& arguments) {
  auto parsed = Parse(arguments);
  if (const auto* stop = std::get_if<ConfigExit>(&parsed)) {
    ADD_FAILURE() << stop->output;
    return {};
  }
  return std::get<Config>(std::move(parsed));
}

ConfigExit Stopped(const std::vector<const char*>& arguments) {
  const auto parsed = Parse(arguments);
  if (const auto* stop = std::get_if<ConfigExit>(&parsed)) return *stop;
  ADD_FAILURE() << "accepted " << testing::PrintToString(arguments);
  return {};
}

/// Sets a variable for the length of a test.
class Environment {
 public:
  Environment(const char* name, const char* value) : name_(name) { setenv(name, value, 1); }
  ~Environment() { unsetenv(name_); }
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;

 private:
  const char* name_;
};

TEST(Config, HasTheDefaultsOfTheContract) {
  const Config config = Accepted({});
  EXPECT_EQ(config.host, "127.0.0.1");
  EXPECT_EQ(config.port, 8080);
  EXPECT_GE(config.threads, 1);
  EXPECT_EQ(config.memory_limit_bytes, std::uint64_t{4} << 30);
  EXPECT_FALSE(config.store_limit_bytes);
  EXPECT_EQ(config.limits.max_upload_bytes, std::uint64_t{1} << 30);
  EXPECT_EQ(config.limits.max_rays, 4'000'000U);
  EXPECT_EQ(config.limits.max_pixels, 67'108'864U);
  EXPECT_EQ(config.max_connections, 1024U);
  EXPECT_TRUE(config.token_file.empty());
}

TEST(Config, ReadsEveryOption) {
  const Config config = Accepted({"--host",   "0.0.0.0",
                                  "--port=0", "--data-dir",
                                  "/d",       "--threads",
                                  "3",        "--memory-limit",
                                  "512MiB",   "--store-limit",
                                  "10GB",     "--max-upload",
                                  "1000",     "--max-rays",
                                  "5",        "--max-pixels",
                                  "6",        "--max-connections",
                                  "7",        "--max-running",
                                  "8",        "--max-queued",
                                  "0",        "--token-file",
                                  "/t",       "--drain-timeout-ms",
                                  "9"});
  EXPECT_EQ(config.host, "0.0.0.0");
  EXPECT_EQ(config.port, 0);
  EXPECT_EQ(config.data_dir, "/d");
  EXPECT_EQ(config.threads, 3);
  EXPECT_EQ(config.memory_limit_bytes, std::uint64_t{512} << 20);
  EXPECT_EQ(config.store_limit_bytes, 10'000'000'000U);
  EXPECT_EQ(config.limits.max_upload_bytes, 1000U);
  EXPECT_EQ(config.limits.max_rays, 5U);
  EXPECT_EQ(config.limits.max_pixels, 6U);
  EXPECT_EQ(config.max_connections, 7U);
  EXPECT_EQ(config.max_running, 8U);
  EXPECT_EQ(config.max_queued, 0U);
  EXPECT_EQ(config.token_file, "/t");
  EXPECT_EQ(config.drain_timeout_ms, 9);
}

TEST(Config, ReadsSizesWithAndWithoutUnits) {
  for (const auto& [text, bytes] :
       {std::pair("1", 1ULL), std::pair("1048576", 1ULL << 20), std::pair("3KiB", 3ULL << 10),
        std::pair("3 kib", 3ULL << 10), std::pair("2GB", 2'000'000'000ULL), std::pair("5b", 5ULL),
        std::pair("1TiB", 1ULL << 40)}) {
    EXPECT_EQ(Accepted({"--max-upload", text}).limits.max_upload_bytes, bytes) << text;
  }
  for (const char* text : {"0", "-1", "+1", "1.5GiB", "GiB", "", " 1", "1 2", "1XB", "99999999TiB",
                           "99999999999999999999", "0x10", "lots"}) {
    EXPECT_EQ(Stopped({"--max-upload", text}).code, 2) << text;
  }
}

TEST(Config, ReadsOptionsFromTheEnvironmentUnlessTheCommandLineHasThem) {
  const Environment port("KDRAY_PORT", "1234");
  const Environment data_dir("KDRAY_DATA_DIR", "/from/environment");
  const Environment limit("KDRAY_MEMORY_LIMIT", "1GiB");
  const Config config = Accepted({"--port", "99"});
  EXPECT_EQ(config.port, 99);
  EXPECT_EQ(config.data_dir, "/from/environment");
  EXPECT_EQ(config.memory_limit_bytes, std::uint64_t{1} << 30);
}

TEST(Config, RefusesAWrongValueInTheEnvironmentAsOnTheCommandLine) {
  for (const auto& [name, value] :
       {std::pair("KDRAY_PORT", "many"), std::pair("KDRAY_PORT", "70000"),
        std::pair("KDRAY_MEMORY_LIMIT", "4 parsecs")}) {
    const Environment wrong(name, value);
    const ConfigExit stop = Stopped({});
    EXPECT_EQ(stop.code, 2) << name << value;
  }
}

TEST(Config, TakesTheNameOfALogLevel) {
  EXPECT_EQ(Accepted({}).log_level, LogLevel::kInfo);
  EXPECT_EQ(Accepted({"--log-level", "warning"}).log_level, LogLevel::kWarning);
  EXPECT_EQ(Accepted({"--log-level", "error"}).log_level, LogLevel::kError);
  const Environment level("KDRAY_LOG_LEVEL", "warning");
  EXPECT_EQ(Accepted({}).log_level, LogLevel::kWarning);
  for (const char* name : {"", "Info", "debug", "2"}) {
    EXPECT_EQ(Stopped({"--log-level", name}).code, 2) << name;
  }
}

TEST(Config, TakesOriginsAndSaysWhatIsNone) {
  EXPECT_FALSE(Accepted({}).cors.is_enabled());
  EXPECT_TRUE(Accepted({"--allow-origin", "*"}).cors.is_enabled());
  EXPECT_TRUE(Accepted({"--allow-origin", "https://a.example,http://b:81"}).cors.is_enabled());
  const Environment variable("KDRAY_ALLOW_ORIGIN", "https://a.example/path");
  EXPECT_EQ(Stopped({}).code, 2);
  const ConfigExit stopped = Stopped({"--allow-origin", "https://a.example,b"});
  EXPECT_EQ(stopped.code, 2);
  EXPECT_NE(stopped.output.find("'b' is not an origin"), std::string::npos) << stopped.output;
}

TEST(Config, EndsWithTwoForWrongOptions) {
  for (const auto& arguments :
       std::vector<std::vector<const char*>>{{"--no-such-option"},
                                             {"stray"},
                                             {"--port", "65536"},
                                             {"--port", "-1"},
                                             {"--host", ""},
                                             {"--data-dir", ""},
                                             {"--token-file", ""},
                                             {"--token-file="},
                                             {"--port", "x"},
                                             {"--port"},
                                             {"--threads", "0"},
                                             {"--threads", "1.5"},
                                             {"--max-rays", "0"},
                                             {"--max-rays", "-1"},
                                             {"--max-pixels", "99999999999"},
                                             {"--max-connections", "0"},
                                             {"--memory-limit", "lots"},
                                             {"--memory-limit", "-1"},
                                             {"--max-upload", "1XB"}}) {
    const ConfigExit stop = Stopped(arguments);
    EXPECT_EQ(stop.code, 2) << testing::PrintToString(arguments);
    EXPECT_FALSE(stop.output.empty());
  }
}

TEST(Config, EndsWithZeroForHelpAndVersion) {
  const ConfigExit help = Stopped({"--help"});
  EXPECT_EQ(help.code, 0);
  for (const char* option : {"--host", "--port", "--data-dir", "--threads", "--memory-limit",
                             "--store", "--store-limit", "--max-upload", "--max-rays",
                             "--max-pixels", "--max-connections", "--token-file", "KDRAY_"}) {
    EXPECT_NE(help.output.find(option), std::string::npos) << option;
  }
  const ConfigExit version = Stopped({"--version"});
  EXPECT_EQ(version.code, 0);
  EXPECT_EQ(version.output, "kdrayd " KDRAY_VERSION "\n");
}

}  // namespace
}  // namespace kdray::server
