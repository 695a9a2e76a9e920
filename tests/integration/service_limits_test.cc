// SPDX-License-Identifier: Apache-2.0
// The contract over a real socket: deadlines, departures, limits, the end.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "api/errors.h"
#include "tests/integration/service_over_http.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using test::Json;
using test::MakeRequest;
using test::RawAnswer;
using test::RawClient;
using test::RunningService;
using testing::HasSubstr;
using testing::StartsWith;

class SmallService : public ServiceOverHttp {
 protected:
  SmallService() : ServiceOverHttp(Small()) {}
  static ServiceOptions Small() {
    ServiceOptions options;
    options.max_running = 1;
    options.max_queued = 1;
    options.limits.max_upload_bytes = 100;
    options.limits.max_rays = 3;
    options.limits.max_pixels = 100;
    options.request_memory_bytes = 16 * 1024;
    return options;
  }
};

TEST_F(ServiceOverHttp, EndsAQueryAtItsDeadline) {
  backend_.hold = true;
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(running_.Code("POST", Tree("/rays/any?deadline_ms=50"), kRays), "deadline_exceeded");
  EXPECT_EQ(running_.Code("GET", Tree("/render.png?deadline_ms=50")), "deadline_exceeded");
  EXPECT_LT(std::chrono::steady_clock::now() - start, 5s);
}

TEST_F(ServiceOverHttp, SaysWhichTimeHasPassed) {
  const std::string building = "/v1/trees/" + running_.Upload("building", "?wait_ms=0");
  backend_.hold = true;
  const std::string json_render = R"({"deadline_ms":34})";
  const auto expect = [](const RawAnswer& answer, const std::string& code,
                         const std::string& parameter, double limit, const std::string& text) {
    const json problem = Json(answer);
    EXPECT_EQ(problem.at("code"), code);
    EXPECT_EQ(problem.value("parameter", ""), parameter) << problem;
    EXPECT_EQ(problem.at("limit"), limit) << problem;
    EXPECT_THAT(problem.at("detail").get<std::string>(), HasSubstr(text));
  };
  const std::string late = "deadline_exceeded";
  expect(running_.Ask("POST", Tree("/rays/closest?deadline_ms=31"), kRays), late, "deadline_ms", 31,
         "deadline_ms is 31");
  expect(running_.Ask("POST", Tree("/rays/any?deadline_ms=32"), kRays), late, "deadline_ms", 32,
         "deadline_ms is 32");
  expect(running_.Ask("GET", Tree("/render.npy?mode=depth&deadline_ms=33")), late, "deadline_ms",
         33, "deadline_ms is 33");
  expect(running_.Ask("POST", Tree("/render.png"), json_render), late, "/deadline_ms", 34,
         "deadline_ms is 34");
  expect(running_.Ask("POST", building + "/rays/any?deadline_ms=35", kRays), "tree_building",
         "deadline_ms", 35, "deadline_ms is 35");
  expect(running_.Ask("GET", building + "/render.png?deadline_ms=36"), "tree_building",
         "deadline_ms", 36, "deadline_ms is 36");
  // What was not sent is told as well.
  backend_.query_problem =
      api::Problem{.code = api::ErrorCode::kDeadlineExceeded, .detail = "late"};
  expect(running_.Ask("POST", Tree("/rays/any"), kRays), late, "deadline_ms", 30000,
         "deadline_ms is 30000, the default");
  expect(running_.Ask("GET", Tree("/render.png")), late, "deadline_ms", 60000,
         "deadline_ms is 60000, the default");
  expect(running_.Ask("GET", Tree("/cells?depth=1")), late, "", 30000, "30000 ms");
}

TEST_F(SmallService, SaysWhichTimeHasPassedInTheQueue) {
  backend_.hold = true;
  RawClient running(running_.port());
  running.Send(MakeRequest("GET", Tree("/render.png?width=1&height=1")));
  WaitFor([&] { return backend_.running == 1; });
  const RawAnswer late = running_.Ask("GET", Tree("/render.png?width=1&height=1&deadline_ms=37"));
  EXPECT_EQ(RunningService::CodeOf(late), "deadline_exceeded");
  EXPECT_EQ(Json(late).at("parameter"), "deadline_ms");
  EXPECT_EQ(Json(late).at("limit"), 37);
  EXPECT_THAT(Json(late).at("detail").get<std::string>(),
              testing::AllOf(HasSubstr("turn"), HasSubstr("deadline_ms is 37")));
}

TEST_F(ServiceOverHttp, TellsThatAClientHasLeftFromWhatFailed) {
  const std::string building = running_.Upload("building", "?wait_ms=0");
  backend_.hold = true;
  const std::string tree = "/v1/trees/" + building;
  const std::vector<std::string> requests = {
      MakeRequest("POST", "/v1/trees?wait_ms=20000", "building"),
      MakeRequest("GET", tree + "?wait_ms=20000"),
      MakeRequest("POST", tree + "/rays/any", kRays),
      MakeRequest("GET", tree + "/render.png"),
      MakeRequest("POST", Tree("/rays/closest"), kRays),
      MakeRequest("GET", Tree("/render.npy?mode=depth")),
      MakeRequest("GET", Tree("/cells?depth=1")),
  };
  std::uint64_t gone = 0;
  for (const std::string& request : requests) {
    for (const bool reset : {false, true}) {
      RawClient client(running_.port());
      client.Send(request);
      std::this_thread::sleep_for(10ms);  // real time: some leave before the work has begun
      reset ? client.Reset() : client.Close();
      ++gone;
      WaitFor([&] { return running_.service().clients_gone() == gone; });
    }
  }
}

TEST_F(ServiceOverHttp, AnswersAClientThatHalfClosesWhateverItAsksFor) {
  const std::string building = running_.Upload("building", "?wait_ms=0");
  backend_.hold = true;
  for (const std::string& request :
       {MakeRequest("GET", "/v1/trees/" + building + "?wait_ms=100"),
        MakeRequest("POST", Tree("/rays/any"), kRays), MakeRequest("GET", Tree("/render.png")),
        MakeRequest("GET", Tree("/cells?depth=1"))}) {
    RawClient client(running_.port());
    client.Send(request);
    client.ShutdownWrite();
    std::this_thread::sleep_for(50ms);  // real time: the watch sees that the client sends no more
    backend_.hold = false;
    EXPECT_THAT(client.ReadToEnd(), StartsWith("HTTP/1.1 200 OK\r\n"));
    backend_.hold = true;
  }
}

TEST_F(ServiceOverHttp, StopsWorkWhoseClientHasLeft) {
  backend_.hold = true;
  for (const std::string& request :
       {MakeRequest("POST", Tree("/rays/closest"), kRays), MakeRequest("GET", Tree("/render.png")),
        MakeRequest("GET", Tree("/cells?depth=1"))}) {
    const int cancelled = backend_.cancelled;
    RawClient client(running_.port());
    client.Send(request);
    WaitFor([&] { return backend_.running == 1; });
    const auto left = std::chrono::steady_clock::now();
    client.Close();
    WaitFor([&] { return backend_.cancelled == cancelled + 1; });
    EXPECT_LT(std::chrono::steady_clock::now() - left, 250ms) << request;
  }
}

TEST_F(ServiceOverHttp, KeepsTheConnectionBetweenBatches) {
  const std::string path = Tree("/rays/any");
  RawClient client(running_.port());
  for (int i = 0; i < 50; ++i) {
    client.Send(MakeRequest("POST", path, kRays));
    const auto answer = client.Read();
    ASSERT_TRUE(answer) << i;
    EXPECT_EQ(answer->status, 200);
  }
}

TEST_F(ServiceOverHttp, RefusesAnUploadBeforeItsBodyIsSent) {
  RawClient client(running_.port());
  client.Send(
      "POST /v1/trees HTTP/1.1\r\nHost: h\r\nContent-Length: 9999999999\r\nExpect: "
      "100-continue\r\n\r\n");
  const auto answer = client.Read();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 413);
  EXPECT_EQ(RunningService::CodeOf(*answer), "mesh_too_large");
}

TEST_F(ServiceOverHttp, LeavesNothingOfAnUploadThatBreaksOff) {
  {
    RawClient client(running_.port());
    client.Send("POST /v1/trees HTTP/1.1\r\nHost: h\r\nContent-Length: 100\r\n\r\nhalf");
    client.ShutdownWrite();
    EXPECT_EQ(RunningService::CodeOf(*client.Read()), "malformed_request");
  }
  EXPECT_TRUE(Json(running_.Ask("GET", "/v1/trees")).at("trees").empty());
}

TEST_F(ServiceOverHttp, DrainsBeforeItEnds) {
  const std::string query = MakeRequest("POST", Tree("/rays/any"), kRays);
  backend_.hold = true;
  RawClient busy(running_.port());
  busy.Send(query);
  WaitFor([&] { return backend_.running == 1; });
  running_.service().Drain();
  running_.server().Drain();
  EXPECT_EQ(running_.Ask("GET", "/healthz").status, 200);
  EXPECT_EQ(running_.Code("GET", "/readyz"), "draining");
  const RawAnswer refused = running_.Ask("GET", "/v1/trees");
  EXPECT_EQ(RunningService::CodeOf(refused), "draining");
  EXPECT_NE(refused.Header("retry-after"), "");
  backend_.hold = false;
  EXPECT_EQ(busy.Read()->status, 200);
  EXPECT_TRUE(running_.server().WaitUntilIdle(std::chrono::steady_clock::now() + 5s));
}

TEST_F(SmallService, AnswersAtTheLimitsAndRefusesBeyond) {
  // The memory of a request is returned just after its answer was sent.
  const auto ask = [&](const std::string& method, const std::string& target,
                       const std::string& body = "") {
    WaitFor([&] { return running_.service().request_memory_used() == 0; });
    return running_.Ask(method, target, body);
  };
  const auto code = [&](const std::string& method, const std::string& target,
                        const std::string& body = "") {
    return RunningService::CodeOf(ask(method, target, body));
  };
  EXPECT_EQ(ask("POST", "/v1/trees", std::string(100, 'm')).status, 201);
  EXPECT_EQ(code("POST", "/v1/trees", std::string(101, 'm')), "mesh_too_large");
  EXPECT_EQ(ask("POST", Tree("/rays/any"), NpyRays(std::vector<float>(18, 1))).status, 200);
  EXPECT_EQ(code("POST", Tree("/rays/any"), NpyRays(std::vector<float>(24, 1))), "too_many_rays");
  EXPECT_EQ(code("POST", Tree("/rays/any"),
                 "{\"rays\":[[1,1,1,1,1,1],[1,1,1,1,1,1],[1,1,1,1,1,1],[1,1,1,1,1,1]]}"),
            "too_many_rays");
  EXPECT_EQ(code("POST", Tree("/rays/any"), std::string(4096 + 3 * 200 + 1, ' ')),
            "body_too_large");
  EXPECT_EQ(ask("GET", Tree("/render.png?width=10&height=10")).status, 200);
  EXPECT_EQ(code("GET", Tree("/render.png?width=10&height=11")), "image_too_large");
  EXPECT_EQ(code("GET", Tree("/render.png?width=20000&height=1")), "image_too_large");
  EXPECT_EQ(ask("GET", Tree("/render.png?width=10&height=11&region=0,0,10,10")).status, 200);
}

TEST_F(SmallService, QueuesAsManyAsItSaysAndRefusesTheRestAtOnce) {
  const std::string path = Tree("/rays/any");
  backend_.hold = true;
  // Bodies of nothing but a few bytes, so that only the queue is full, not the memory.
  RawClient running(running_.port()), queued(running_.port());
  const std::string cells = MakeRequest("GET", Tree("/cells?depth=1"));
  running.Send(cells);
  WaitFor([&] { return backend_.running == 1; });
  queued.Send(cells);
  std::this_thread::sleep_for(50ms);  // real time: the answer says how long it waited
  const auto start = std::chrono::steady_clock::now();
  const RawAnswer refused = running_.Ask("GET", Tree("/cells?depth=1"));
  EXPECT_LT(std::chrono::steady_clock::now() - start, 1s);
  EXPECT_EQ(refused.status, 503);
  EXPECT_EQ(RunningService::CodeOf(refused), "overloaded");
  EXPECT_EQ(refused.Header("retry-after"), "1");
  EXPECT_EQ(running_.Ask("GET", "/healthz").status, 200);
  backend_.hold = false;
  EXPECT_EQ(running.Read()->status, 200);
  const auto answer = queued.Read();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200);
  const std::string timing = answer->Header("server-timing");
  EXPECT_GT(std::stod(timing.substr(timing.find("dur=") + 4)), 40) << timing;
  EXPECT_EQ(backend_.most_running, 1);
}

TEST_F(SmallService, RefusesBeforeTheBodyAndKeepsTheConnection) {
  const std::string path = Tree("/rays/any");
  backend_.hold = true;
  RawClient running(running_.port()), queued(running_.port());
  running.Send(MakeRequest("POST", path, kRays));
  WaitFor([&] { return backend_.running == 1; });
  queued.Send(MakeRequest("POST", path, kRays));
  WaitFor([&] {
    return running_.Ask("GET", "/metrics").body.find("\nkdray_queued_requests 1\n") !=
           std::string::npos;
  });
  RawClient client(running_.port());
  const std::string request = MakeRequest("POST", path, kRays);
  client.Send(request.substr(0, request.size() - std::string_view(kRays).size()));
  const auto refused = client.Read();
  ASSERT_TRUE(refused) << "the answer comes before the body";
  EXPECT_EQ(RunningService::CodeOf(*refused), "overloaded");
  EXPECT_EQ(refused->Header("connection"), "");
  client.Send(kRays);
  client.Send(MakeRequest("GET", "/healthz"));
  const auto next = client.Read();
  ASSERT_TRUE(next) << "the connection is kept";
  EXPECT_EQ(next->status, 200);
  backend_.hold = false;
  EXPECT_EQ(running.Read()->status, 200);
  EXPECT_EQ(queued.Read()->status, 200);
}

TEST_F(ServiceOverHttp, ABodyThatIsDeclaredAndDoesNotComeExcludesNobody) {
  const std::string path = Tree("/rays/any");
  // More than all memory of requests, and a few bytes of it.
  RawClient slow(running_.port());
  const std::string size = std::to_string(std::uint64_t{360} << 20);
  slow.Send("POST " + path + " HTTP/1.1\r\nHost: a\r\nContent-Length: " + size +
            "\r\n\r\n{\"rays\":[");
  RawClient slow_upload(running_.port());
  slow_upload.Send("POST /v1/trees HTTP/1.1\r\nHost: a\r\nContent-Length: " + size +
                   "\r\n\r\nOFF\n");
  WaitFor([&] { return running_.service().request_memory_used() > 0; });
  for (int i = 0; i < 50; ++i) {
    EXPECT_EQ(running_.Ask("POST", path, kRays).status, 200);
    EXPECT_EQ(running_.Ask("GET", Tree("/render.png?width=64&height=64")).status, 200);
  }
  slow.Send("[0,0");
  EXPECT_EQ(running_.Ask("POST", path, kRays).status, 200);
}

// Room for one query: 128 bytes of rows and 192 of its block. 112 of the bytes are not for bodies.
class TightService : public ServiceOverHttp {
 protected:
  TightService() : ServiceOverHttp(Tight()) {}
  static ServiceOptions Tight() {
    ServiceOptions options;
    options.request_memory_bytes = 450;
    return options;
  }
};

TEST_F(TightService, RefusesBodiesThatDoNotFitIntoItsMemoryNow) {
  const std::string path = Tree("/rays/any");
  backend_.hold = true;
  RawClient first(running_.port());
  first.Send(MakeRequest("POST", path, kRays));
  WaitFor([&] { return backend_.running == 1; });
  const RawAnswer refused = running_.Ask("POST", path, kRays);
  EXPECT_EQ(refused.status, 503);
  EXPECT_EQ(RunningService::CodeOf(refused), "memory_full");
  EXPECT_NE(refused.Header("retry-after"), "");
  backend_.hold = false;
  EXPECT_EQ(first.Read()->status, 200);
  // Memory is returned after the answer has been sent.
  WaitFor([&] { return running_.service().request_memory_used() == 0; });
  EXPECT_EQ(running_.Ask("POST", path, kRays).status, 200);
}

TEST_F(TightService, RefusesForGoodWhatNeverFitsIntoItsMemory) {
  const auto expect = [&](const std::string& code, const RawAnswer& answer) {
    EXPECT_EQ(answer.status, 413);
    EXPECT_EQ(RunningService::CodeOf(answer), code);
    EXPECT_EQ(answer.Header("retry-after"), "");
    EXPECT_THAT(answer.body, HasSubstr("--memory-limit"));
  };
  const std::string six_rows =
      "{\"rays\":[[0,0,1,0,0,1],[0,0,1,0,0,1],[0,0,1,0,0,1],[0,0,1,0,0,1],[0,0,1,0,0,1],"
      "[0,0,1,0,0,1]]}";
  expect("too_many_rays", running_.Ask("POST", Tree("/rays/any"), six_rows));
  expect("too_many_hits", running_.Ask("POST", Tree("/rays/all"), kRays));
  expect("body_too_large", running_.Ask("POST", Tree("/rays/any"), std::string(400, ' ')));
  expect("image_too_large", running_.Ask("GET", Tree("/render.png?width=10&height=10")));
  expect("image_too_large", running_.Ask("GET", Tree("/render.npy?width=10&height=10")));
  expect("too_many_cells", running_.Ask("GET", Tree("/cells?depth=1")));
  WaitFor([&] { return running_.service().request_memory_used() == 0; });
}

TEST_F(TightService, RefusesTheNewestBodyWhenItsMemoryIsFull) {
  const std::string path = Tree("/rays/any");
  std::string rays = kRays;
  rays.append(170 - rays.size(), ' ');
  const auto begin = [&](RawClient& client, const std::string& first_bytes) {
    const std::uint64_t used = running_.service().request_memory_used();
    client.Send("POST " + path + " HTTP/1.1\r\nHost: a\r\nContent-Length: " +
                std::to_string(rays.size()) + "\r\n\r\n");
    client.Send(first_bytes);
    WaitFor([&] { return running_.service().request_memory_used() == used + first_bytes.size(); });
  };
  RawClient older(running_.port()), newest(running_.port());
  begin(older, rays.substr(0, rays.size() - 10));
  begin(newest, rays.substr(0, rays.size() - 1));
  older.Send(rays.substr(rays.size() - 10));
  const auto answered = older.Read();
  ASSERT_TRUE(answered);
  EXPECT_EQ(answered->status, 200) << answered->body;
  newest.Send(rays.substr(rays.size() - 1));
  const auto refused = newest.Read();
  ASSERT_TRUE(refused);
  EXPECT_EQ(RunningService::CodeOf(*refused), "memory_full");
  WaitFor([&] { return running_.service().request_memory_used() == 0; });
  EXPECT_EQ(running_.Ask("POST", path, kRays).status, 200);
}

}  // namespace
}  // namespace kdray::server
