// SPDX-License-Identifier: Apache-2.0
// kdrayd as a process: its line, its exit codes, its end, and what is left after a crash.
#include "tests/integration/daemon.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/mesh_files.h"
#include "tests/support/npy_array.h"
#include "tests/support/obj_text.h"
#include "tests/support/raw_client.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/wait_until.h"

namespace kdray::server {
namespace {

using nlohmann::json;
using test::Ask;
using test::Daemon;
using test::MakeRequest;
using test::RawAnswer;
using test::RawClient;
using testing::HasSubstr;
using testing::MatchesRegex;

class DaemonProcess : public testing::Test {
 protected:
  std::vector<std::string> Options(std::vector<std::string> more = {}) {
    std::vector<std::string> options = {"--port", "0", "--data-dir",
                                        (folder_.path() / "data").string()};
    options.insert(options.end(), more.begin(), more.end());
    return options;
  }
  static int PortOf(Daemon& daemon) {
    const auto port = daemon.WaitForPort();
    EXPECT_TRUE(port) << daemon.errors();
    return port.value_or(0);
  }
  static RawAnswer MustAnswer(int port, const std::string& request) {
    auto answer = Ask(port, request);
    if (!answer) ADD_FAILURE() << "no answer to " << request.substr(0, request.find('\r'));
    return answer.value_or(RawAnswer());
  }

  test::TemporaryFolder folder_;
};

/// Some rays at a mesh around the origin, as .npy.
std::string SomeRays(std::size_t count) {
  std::vector<float> numbers;
  for (std::size_t i = 0; i < count; ++i) {
    const float x = static_cast<float>(i % 97) / 48 - 1, y = static_cast<float>(i % 89) / 44 - 1;
    numbers.insert(numbers.end(), {x, y, 5, -x / 9, y / 7, -1});
  }
  return test::NpyArray(numbers, 6);
}

TEST_F(DaemonProcess, SaysWhereItListensAndEndsWhenTold) {
  for (const int signal : {SIGTERM, SIGINT}) {
    Daemon daemon(Options());
    const int port = PortOf(daemon);
    EXPECT_THAT(daemon.output(),
                MatchesRegex("kdrayd listening on http://127\\.0\\.0\\.1:[0-9]+\n"));
    EXPECT_EQ(MustAnswer(port, MakeRequest("GET", "/readyz")).status, 200);
    daemon.Signal(signal);
    EXPECT_EQ(daemon.WaitForExit(), 0) << daemon.errors();
  }
}

TEST_F(DaemonProcess, EndsWithTwoForWrongOptions) {
  Daemon daemon({"--prot", "1"});
  EXPECT_EQ(daemon.WaitForExit(), 2);
  EXPECT_THAT(daemon.errors(), HasSubstr("--prot"));
  Daemon version({"--version"});
  EXPECT_EQ(version.WaitForExit(), 0);
  EXPECT_EQ(version.output(), "kdrayd " KDRAY_VERSION "\n");
}

#ifdef KDRAY_FLUSH_TO_ZERO
// N22 of the catalogue.
TEST_F(DaemonProcess, N22RefusesToStartWhereNumbersAreFlushedToZero) {
  Daemon daemon(Options(), {"LD_PRELOAD=" KDRAY_FLUSH_TO_ZERO});
  EXPECT_EQ(daemon.WaitForPort(), std::nullopt);
  EXPECT_EQ(daemon.WaitForExit(), 1);
  EXPECT_THAT(daemon.errors(), HasSubstr("denormal"));
}
#endif

TEST_F(DaemonProcess, RefusesAPortOrADataDirectoryThatIsTaken) {
  Daemon first(Options());
  const int port = PortOf(first);
  Daemon same_port(
      {"--port", std::to_string(port), "--data-dir", (folder_.path() / "other").string()});
  EXPECT_EQ(same_port.WaitForExit(), 1);
  EXPECT_THAT(same_port.errors(), HasSubstr("in use"));
  EXPECT_EQ(same_port.output(), "");
  Daemon same_data(Options());
  EXPECT_EQ(same_data.WaitForExit(), 1);
  EXPECT_EQ(same_data.output(), "");
  EXPECT_EQ(MustAnswer(port, MakeRequest("GET", "/healthz")).status, 200);
}

TEST_F(DaemonProcess, EndsWithOneLineWhereItsDataAreNotAsItLeftThem) {
  const auto meshes = folder_.path() / "data" / "meshes";
  const auto away = folder_.path() / "away";
  {
    Daemon daemon(Options());
    const int port = PortOf(daemon);
    const std::string mesh = test::ObjText(test::IcoSphere({0, 0, 0}, 1, 1));
    EXPECT_EQ(MustAnswer(port, MakeRequest("POST", "/v1/trees", mesh)).status, 201);
    daemon.Signal(SIGTERM);
    EXPECT_EQ(daemon.WaitForExit(), 0);
  }
  std::filesystem::rename(meshes, away);
  Daemon refused(Options());
  EXPECT_EQ(refused.WaitForExit(), 1);
  EXPECT_EQ(refused.output(), "");
  const std::string errors = refused.errors();
  ASSERT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1) << errors;
  const std::string message = json::parse(errors).at("message");
  EXPECT_THAT(message, HasSubstr((folder_.path() / "data").string()));
  EXPECT_THAT(message, HasSubstr("folder meshes is missing"));
  EXPECT_FALSE(std::filesystem::exists(meshes));

  std::filesystem::rename(away, meshes);
  Daemon daemon(Options());
  const RawAnswer list = MustAnswer(PortOf(daemon), MakeRequest("GET", "/v1/trees"));
  EXPECT_EQ(json::parse(list.body).at("trees").size(), 1u);
}

TEST_F(DaemonProcess, TakesOptionsFromTheEnvironment) {
  Daemon daemon({}, {"KDRAY_PORT=0", "KDRAY_DATA_DIR=" + (folder_.path() / "data").string(),
                     "KDRAY_MAX_UPLOAD=10"});
  const int port = PortOf(daemon);
  EXPECT_EQ(MustAnswer(port, MakeRequest("POST", "/v1/trees", std::string(11, 'x'))).status, 413);
}

TEST_F(DaemonProcess, WantsTheTokensOfItsFileAndLogsNone) {
  const auto file = folder_.path() / "tokens";
  std::ofstream(file) << "very-secret-token\n";
  Daemon daemon(Options({"--token-file", file.string()}));
  const int port = PortOf(daemon);
  EXPECT_EQ(MustAnswer(port, MakeRequest("GET", "/v1")).status, 401);
  EXPECT_EQ(
      MustAnswer(port, MakeRequest("GET", "/v1", "", "Authorization: Bearer very-secret-token\r\n"))
          .status,
      200);
  daemon.Signal(SIGTERM);
  EXPECT_EQ(daemon.WaitForExit(), 0);
  EXPECT_EQ(daemon.errors().find("very-secret"), std::string::npos);
  Daemon without(Options({"--token-file", (folder_.path() / "none").string()}));
  EXPECT_EQ(without.WaitForExit(), 1);
}

TEST_F(DaemonProcess, SaysThatAFolderHoldsNoTokens) {
  Daemon daemon(Options({"--token-file", folder_.path().string()}));
  EXPECT_EQ(daemon.WaitForExit(), 1);
  const std::string message = json::parse(daemon.errors()).at("message");
  EXPECT_EQ(message, "cannot read " + folder_.path().string());
}

TEST_F(DaemonProcess, WritesItsLogIntoNoFileOfItsOwnWhenItsStreamIsClosed) {
  for (const int closed : {STDIN_FILENO, STDERR_FILENO}) {
    Daemon daemon(Options(), {}, closed);
    const int port = PortOf(daemon);
    const std::string mesh = test::ObjText(test::IcoSphere({0, 0, 0}, 1, closed));
    EXPECT_EQ(MustAnswer(port, MakeRequest("POST", "/v1/trees", mesh)).status, 201);
    daemon.Signal(SIGTERM);
    EXPECT_EQ(daemon.WaitForExit(), 0);
    EXPECT_EQ(std::filesystem::file_size(folder_.path() / "data" / "lock"), 0u) << closed;
  }
}

TEST_F(DaemonProcess, LogsOneJsonObjectALine) {
  Daemon daemon(Options());
  const int port = PortOf(daemon);
  MustAnswer(port, MakeRequest("GET", "/no%0asuch\"path", "", "X-Request-Id: the-id\r\n"));
  Ask(port, "GARBAGE \x01\x02\r\n\r\n");
  daemon.Signal(SIGTERM);
  EXPECT_EQ(daemon.WaitForExit(), 0);
  std::istringstream lines(daemon.errors());
  bool found = false;
  for (std::string line; std::getline(lines, line);) {
    const json object = json::parse(line, nullptr, false);
    ASSERT_FALSE(object.is_discarded()) << line;
    EXPECT_TRUE(object.contains("time") && object.contains("level") && object.contains("event"))
        << line;
    if (object.value("request_id", "") != "the-id") continue;
    found = true;
    EXPECT_EQ(object.at("method"), "GET");
    EXPECT_EQ(object.at("path"), "/no%0asuch\"path");
    EXPECT_EQ(object.at("status"), 404);
    EXPECT_EQ(object.at("code"), "not_found");
    EXPECT_GE(object.at("ms"), 0);
    EXPECT_GT(object.at("bytes_out"), 0);
  }
  EXPECT_TRUE(found);
}

TEST_F(DaemonProcess, AnswersAndEndsWhileNobodyReadsItsLog) {
  constexpr int kRequests = 6000;
  Daemon daemon(Options());
  const int port = PortOf(daemon);
  daemon.StopReadingErrors();
  const auto start = std::chrono::steady_clock::now();
  RawClient client(port);
  for (int i = 0; i < kRequests; ++i) {
    client.Send(MakeRequest("GET", "/healthz", "", "X-Request-Id: " + std::to_string(i) + "\r\n"));
    const auto answer = client.Read(std::chrono::seconds(5));
    ASSERT_TRUE(answer) << i;
    ASSERT_EQ(answer->status, 200);
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
  daemon.Signal(SIGTERM);
  EXPECT_EQ(daemon.WaitForExit(std::chrono::seconds(3)), 0);
}

TEST_F(DaemonProcess, GoesOnLoggingWhenItsLogIsReadAgain) {
  Daemon daemon(Options());
  const int port = PortOf(daemon);
  daemon.StopReadingErrors();
  RawClient client(port);
  int asked = 0;
  const auto ask = [&] {
    client.Send(
        MakeRequest("GET", "/healthz", "", "X-Request-Id: " + std::to_string(asked++) + "\r\n"));
    ASSERT_TRUE(client.Read());
  };
  while (asked < 6000) ask();
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (daemon.errors().find("log_dropped") == std::string::npos) {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline);
    ask();
  }
  daemon.Signal(SIGTERM);
  EXPECT_EQ(daemon.WaitForExit(std::chrono::seconds(20)), 0);
  int next = 0, dropped = 0;
  std::istringstream lines(daemon.errors());
  json object;
  for (std::string line; std::getline(lines, line);) {
    object = json::parse(line, nullptr, false);
    ASSERT_FALSE(object.is_discarded()) << line;
    if (object.at("event") == "log_dropped") {
      dropped += object.at("lines").get<int>();
      next += object.at("lines").get<int>();
    } else if (object.at("event") == "request") {
      EXPECT_EQ(object.at("request_id"), std::to_string(next++));
    }
  }
  EXPECT_EQ(next, asked);
  EXPECT_GT(dropped, 0);
  EXPECT_EQ(object.at("event"), "stopped");
}

TEST_F(DaemonProcess, OutlivesTheReaderOfItsLog) {
  Daemon daemon(Options());
  const int port = PortOf(daemon);
  daemon.CloseErrors();
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(MustAnswer(port, MakeRequest("GET", "/healthz")).status, 200);
  }
  daemon.Signal(SIGTERM);
  EXPECT_EQ(daemon.WaitForExit(std::chrono::seconds(20)), 0);
}

TEST_F(DaemonProcess, LogsAClientThatLeavesAsThat) {
  Daemon daemon(Options());
  const int port = PortOf(daemon);
  const std::string mesh = test::ObjText(test::BumpySphere({0, 0, 0}, 1, 40, 80, 0.3));
  const std::string id =
      json::parse(MustAnswer(port, MakeRequest("POST", "/v1/trees", mesh)).body).at("id");
  for (const bool reset : {false, true}) {
    RawClient client(port);
    client.Send(MakeRequest("GET",
                            "/v1/trees/" + id + "/render.png?width=2000&height=2000&samples=64", "",
                            "X-Request-Id: gone-" + std::to_string(reset) + "\r\n"));
    // Real time: until the render is under way, which no answer of the daemon says.
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    reset ? client.Reset() : client.Close();
  }
  EXPECT_TRUE(test::WaitUntil([&] {
    const std::string log = daemon.errors();
    return log.find("gone-0") != std::string::npos && log.find("gone-1") != std::string::npos;
  }));
  daemon.Signal(SIGTERM);
  EXPECT_EQ(daemon.WaitForExit(std::chrono::seconds(2)), 0);
  int found = 0;
  std::istringstream lines(daemon.errors());
  for (std::string line; std::getline(lines, line);) {
    const json object = json::parse(line);
    EXPECT_NE(object.at("level"), "error") << line;
    if (object.value("request_id", "").find("gone-") != 0) continue;
    ++found;
    EXPECT_EQ(object.at("status"), 499) << line;
    EXPECT_EQ(object.at("code"), "client_gone") << line;
    EXPECT_EQ(object.at("level"), "info") << line;
    EXPECT_EQ(object.at("complete"), false) << line;
    EXPECT_LT(object.at("ms"), 600) << line;
  }
  EXPECT_EQ(found, 2);
}

TEST_F(DaemonProcess, FinishesWhatIsUnderWayWhenItIsTold) {
  Daemon daemon(Options());
  const int port = PortOf(daemon);
  const std::string mesh = test::ObjText(test::BumpySphere({0, 0, 0}, 1, 40, 80, 0.3));
  const std::string id =
      json::parse(MustAnswer(port, MakeRequest("POST", "/v1/trees", mesh)).body).at("id");
  // The body arrives in two halves with the signal between them: the request is under way when the
  // daemon is told to end.
  const std::string request =
      MakeRequest("POST", "/v1/trees/" + id + "/rays/closest", SomeRays(50'000));
  RawClient client(port);
  client.Send(request.substr(0, request.size() / 2));
  for (int i = 0; i < 100; ++i) {  // until it has been seen to begin
    if (MustAnswer(port, MakeRequest("GET", "/healthz")).status == 200 && i > 3) break;
  }
  daemon.Signal(SIGTERM);
  EXPECT_EQ(daemon.WaitForExit(std::chrono::seconds(1)), -2);
  client.Send(request.substr(request.size() / 2));
  const auto answer = client.Read(std::chrono::seconds(30));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200) << answer->body.substr(0, 300);
  EXPECT_EQ(daemon.WaitForExit(), 0);
}

TEST_F(DaemonProcess, LosesNothingThatItAnsweredWhenItIsKilled) {
  std::vector<std::string> meshes = {test::ObjText(test::IcoSphere({0, 0, 0}, 1, 4))};
  if (const auto folder = test::MeshFolder()) {
    const auto bytes = test::ReadFileBytes(*folder / "stanford_bunny_69k_ascii.ply");
    meshes.emplace_back(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  }
  const std::string rays = SomeRays(1000);
  for (const std::string& mesh : meshes) {
    std::string id, before;
    {
      Daemon daemon(Options());
      const int port = PortOf(daemon);
      const RawAnswer uploaded = MustAnswer(port, MakeRequest("POST", "/v1/trees", mesh));
      ASSERT_EQ(uploaded.status, 201) << uploaded.body;
      id = json::parse(uploaded.body).at("id");
      before =
          MustAnswer(port, MakeRequest("POST", "/v1/trees/" + id + "/rays/closest", rays)).body;
      daemon.Signal(SIGKILL);
      EXPECT_EQ(daemon.WaitForExit(), -1);
    }
    Daemon daemon(Options());
    const int port = PortOf(daemon);
    const RawAnswer tree =
        MustAnswer(port, MakeRequest("GET", "/v1/trees/" + id + "?wait_ms=60000"));
    ASSERT_EQ(tree.status, 200) << tree.body;
    EXPECT_EQ(json::parse(tree.body).at("state"), "ready");
    EXPECT_EQ(MustAnswer(port, MakeRequest("GET", "/v1/trees/" + id + "/mesh")).body, mesh);
    EXPECT_EQ(MustAnswer(port, MakeRequest("POST", "/v1/trees/" + id + "/rays/closest", rays)).body,
              before);
  }
}

TEST_F(DaemonProcess, FinishesABuildThatAKillCutOff) {
  const std::string mesh = test::ObjText(test::BumpySphere({0, 0, 0}, 1, 200, 400, 0.3));
  std::string id;
  {
    Daemon daemon(Options());
    const RawAnswer accepted =
        MustAnswer(PortOf(daemon), MakeRequest("POST", "/v1/trees?wait_ms=0", mesh));
    ASSERT_THAT(accepted.status, testing::AnyOf(201, 202)) << accepted.body;
    id = json::parse(accepted.body).at("id");
    daemon.Signal(SIGKILL);
    daemon.WaitForExit();
  }
  Daemon daemon(Options());
  const RawAnswer tree =
      MustAnswer(PortOf(daemon), MakeRequest("GET", "/v1/trees/" + id + "?wait_ms=60000"));
  ASSERT_EQ(tree.status, 200) << tree.body;
  EXPECT_EQ(json::parse(tree.body).at("state"), "ready");
}

}  // namespace
}  // namespace kdray::server
