// SPDX-License-Identifier: Apache-2.0
// How connections end, from either side: the peer of a connection that the server gives up sees its
// end at once, and a client that leaves is told from one that only has nothing more to send.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/http/http_server.h"
#include "tests/support/raw_client.h"
#include "tests/support/recording_handler.h"
#include "tests/support/wait_until.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using test::MakeRequest;
using test::RawClient;
using Clock = std::chrono::steady_clock;

/// Reads the body, then works under a watch: for a moment at /short, until `let_go` elsewhere.
class WatchingHandler final : public test::RecordingHandler {
 public:
  HttpResponse Handle(const HttpRequest& request) override {
    ++begun;
    if (request.path == "/refuse") {
      return Refuse(request, {.code = api::ErrorCode::kBodyTooLarge, .detail = "too large"});
    }
    std::string body;
    if (const auto problem = ReadBody(request, &body)) return Refuse(request, *problem);
    bool has_left = false;
    if (request.path == "/short") {
      const auto watch = request.peer->CancelWhenGone(core::CancelToken::Cancellable());
      std::this_thread::sleep_for(20ms);  // real time: the watch's thread sleeps on the connection
    } else {
      has_left = !WorkUntilLetGo(request);
    }
    HttpResponse response;
    response.status = has_left ? 504 : 200;
    response.body =
        request.path == "/large" ? std::string(32 << 20, 'x') : request.path + " " + body;
    return response;
  }

  std::atomic<int> begun{0};  ///< requests whose head was read
};

class ConnectionEnds : public testing::Test {
 protected:
  ConnectionEnds() : server_(Options(), handler_) {
    const auto problem = server_.Bind();
    EXPECT_FALSE(problem) << *problem;
    server_.Start();
  }
  ~ConnectionEnds() override {
    handler_.let_go = true;
    server_.Stop();
  }
  static HttpServerOptions Options() {
    HttpServerOptions options;
    options.port = 0;
    options.max_connections = 4;
    options.head_timeout = options.idle_timeout = 300ms;
    options.body_pace = {.grace = 300ms, .bytes_per_second = 100'000, .stall = 300ms};
    options.answer_pace = options.body_pace;
    options.drain_grace = 50ms;
    return options;
  }
  int port() const { return server_.port(); }
  /// How long the work under way goes on.
  Clock::duration WorkGoesOnFor() const {
    const auto start = Clock::now();
    handler_.WaitUntilWorking(0);
    return Clock::now() - start;
  }

  WatchingHandler handler_;
  HttpServer server_;
};

/// A client whose request was watched, and that keeps its connection.
struct WatchedClientOf : RawClient {
  explicit WatchedClientOf(int port) : RawClient(port) {
    Send(MakeRequest("POST", "/short", "body"));
    const auto answer = Read();
    EXPECT_TRUE(answer);
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->body, "/short body");
  }
};

TEST_F(ConnectionEnds, AreSeenAtOnceWhenAConnectionThatWasWatchedIsIdleTooLong) {
  WatchedClientOf client(port());
  EXPECT_TRUE(client.IsClosed(2s));
}

TEST_F(ConnectionEnds, AreSeenAtOnceWhenOthersAreStillWatched) {
  RawClient other(port());
  other.Send(MakeRequest("GET", "/long"));
  handler_.WaitUntilWorking();
  std::vector<std::unique_ptr<WatchedClientOf>> clients;
  for (int i = 0; i < 3; ++i) clients.push_back(std::make_unique<WatchedClientOf>(port()));
  for (auto& client : clients) EXPECT_TRUE(client->IsClosed(2s));
  handler_.let_go = true;
  EXPECT_EQ(other.Read()->status, 200);
}

TEST_F(ConnectionEnds, AreSeenAtOnceWhenAConnectionMakesRoom) {
  std::vector<std::unique_ptr<WatchedClientOf>> clients;
  for (int i = 0; i < 4; ++i) clients.push_back(std::make_unique<WatchedClientOf>(port()));
  const auto start = Clock::now();
  WatchedClientOf late(port());
  EXPECT_TRUE(clients.front()->IsClosed(2s));
  EXPECT_LT(Clock::now() - start, 250ms);  // before its idle time is over
}

TEST_F(ConnectionEnds, AreSeenAtOnceWhenTheServerDrains) {
  WatchedClientOf client(port());
  server_.Drain();
  const auto start = Clock::now();
  EXPECT_TRUE(client.IsClosed(2s));
  EXPECT_LT(Clock::now() - start, 250ms);
  EXPECT_TRUE(server_.WaitUntilIdle(Clock::now() + 2s));
}

TEST_F(ConnectionEnds, AreSaidInAnAnswerToAClientThatAsksWhileTheServerBeginsToDrain) {
  WatchedClientOf client(port());
  server_.Drain();
  client.Send(MakeRequest("POST", "/short", "more"));
  const auto answer = client.Read();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->body, "/short more");
  EXPECT_EQ(answer->Header("connection"), "close");
  EXPECT_TRUE(client.IsClosed(2s));
}

TEST_F(ConnectionEnds, AreSeenAtOnceAfterTheAnswerUnderWayWhenTheServerDrains) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/long"));
  handler_.WaitUntilWorking();
  server_.Drain();
  handler_.let_go = true;
  EXPECT_EQ(client.Read()->body, "/long ");
  EXPECT_TRUE(client.IsClosed(250ms));
}

TEST_F(ConnectionEnds, AreSeenAtOnceWhenTheNextHeadIsTooSlow) {
  WatchedClientOf client(port());
  client.Send("GET /short HTTP/1.1\r\nHo");
  const auto refused = client.Read(2s);
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->status, 408);
  EXPECT_TRUE(client.IsClosed(2s));
}

TEST_F(ConnectionEnds, AreSeenAtOnceWhenTheNextBodyIsTooSlow) {
  WatchedClientOf client(port());
  client.Send("POST /short HTTP/1.1\r\nHost: h\r\nContent-Length: 10\r\n\r\nhalf");
  const auto refused = client.Read(2s);
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->status, 408);
  EXPECT_TRUE(client.IsClosed(2s));
}

TEST_F(ConnectionEnds, AreSeenAtOnceWhenTheNextRequestIsWrong) {
  WatchedClientOf client(port());
  client.Send("nonsense\r\n\r\n");
  EXPECT_EQ(client.Read()->status, 400);
  EXPECT_TRUE(client.IsClosed(2s));
}

TEST_F(ConnectionEnds, AreSeenByAClientThatReadsTooLate) {
  handler_.let_go = true;
  RawClient client(port());
  client.Send(MakeRequest("GET", "/large"));
  EXPECT_FALSE(handler_.NextRecord().complete);
  const auto start = Clock::now();
  EXPECT_TRUE(client.IsClosed(2s));
  EXPECT_LT(Clock::now() - start, 1s);
}

TEST_F(ConnectionEnds, WaitUntilARefusedBodyHasBeenSent) {
  handler_.let_go = true;
  for (const bool chunked : {false, true}) {
    RawClient client(port());
    // Its body is refused at the first byte; the client reads after the last one.
    const std::string piece(100'000, 'x');
    client.Send("POST /refuse HTTP/1.1\r\nHost: h\r\n" +
                std::string(chunked ? "Transfer-Encoding: chunked" : "Content-Length: 20000000") +
                "\r\n\r\n");
    for (int i = 0; i < 200; ++i) {
      ASSERT_TRUE(client.Send(chunked ? "186a0\r\n" + piece + "\r\n" : piece)) << i;
    }
    if (chunked) client.Send("0\r\n\r\n");
    const auto answer = client.Read();
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->status, 413);
    EXPECT_EQ(answer->Header("connection"), "close");
    EXPECT_TRUE(client.IsClosed(2s));
  }
}

TEST_F(ConnectionEnds, AreNotBroughtByAClientThatOnlyHalfCloses) {
  for (const char* version : {"HTTP/1.1", "HTTP/1.0"}) {
    handler_.let_go = false;
    RawClient client(port());
    client.Send("POST /long " + std::string(version) +
                "\r\nHost: h\r\nContent-Length: 4\r\n\r\nbody");
    client.ShutdownWrite();
    handler_.WaitUntilWorking();
    std::this_thread::sleep_for(900ms);  // real time: the watch probes after 250 ms, then 500 ms
    EXPECT_EQ(handler_.working, 1);
    handler_.let_go = true;
    const std::string answer = client.ReadToEnd();
    // Nothing before it, nothing in it and nothing after it.
    EXPECT_EQ(answer.find("HTTP/1.1 200 OK\r\n"), 0U) << answer;
    EXPECT_EQ(answer.rfind("HTTP/"), 0U) << answer;
    EXPECT_EQ(answer.substr(answer.find("\r\n\r\n")), "\r\n\r\n/long body");
    const HttpRecord record = handler_.NextRecord();
    EXPECT_EQ(record.status, 200);
    EXPECT_TRUE(record.complete);
    EXPECT_EQ(record.bytes_out, answer.size());
  }
}

TEST_F(ConnectionEnds, AreNotBroughtByAClientThatHalfClosesAfterSeveralRequests) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/short") + MakeRequest("POST", "/long", "1") +
              MakeRequest("GET", "/short", ""));
  client.ShutdownWrite();
  handler_.WaitUntilWorking();
  std::this_thread::sleep_for(50ms);  // real time: the watch sees that the client sends no more
  handler_.let_go = true;
  for (const char* body : {"/short ", "/long 1", "/short "}) {
    const auto answer = client.Read();
    ASSERT_TRUE(answer) << body;
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->body, body);
  }
  EXPECT_TRUE(client.IsClosed(2s));
}

TEST_F(ConnectionEnds, StopTheWorkOfAClientThatCloses) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/long"));
  handler_.WaitUntilWorking();
  client.Close();
  EXPECT_LT(WorkGoesOnFor(), 250ms);
  const HttpRecord record = handler_.NextRecord();
  EXPECT_EQ(record.status, kClientGone);
  EXPECT_EQ(record.error_code, "client_gone");
  EXPECT_FALSE(record.complete);
}

TEST_F(ConnectionEnds, StopTheWorkOfAClientThatClosesBeforeItBegins) {
  RawClient client(port());
  client.Send(MakeRequest("POST", "/long", "body"));
  client.Close();
  EXPECT_EQ(handler_.NextRecord().status, kClientGone);
}

TEST_F(ConnectionEnds, StopTheWorkOfAClientThatResets) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/long"));
  handler_.WaitUntilWorking();
  client.Reset();
  EXPECT_LT(WorkGoesOnFor(), 250ms);
  EXPECT_EQ(handler_.NextRecord().status, kClientGone);
}

TEST_F(ConnectionEnds, StopTheWorkOfAClientThatHalfClosesAndLeavesLater) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/long"));
  client.ShutdownWrite();
  handler_.WaitUntilWorking();
  EXPECT_FALSE(client.Read(300ms));  // takes what the first probes sent
  client.Close();
  EXPECT_LT(WorkGoesOnFor(), 1s);
  EXPECT_EQ(handler_.NextRecord().status, kClientGone);
}

TEST_F(ConnectionEnds, InTheMiddleOfABodyAreRecordedAsTheyAre) {
  const std::string half = "POST /short HTTP/1.1\r\nHost: h\r\nContent-Length: 10\r\n\r\nhalf";
  RawClient cut(port());
  cut.Send(half);
  cut.ShutdownWrite();
  EXPECT_EQ(cut.Read()->body, "malformed_request");
  EXPECT_EQ(handler_.NextRecord().status, 400);
  for (const bool reset : {false, true}) {
    const int begun = handler_.begun;
    RawClient gone(port());
    gone.Send(half);
    ASSERT_TRUE(test::WaitUntil([&] { return handler_.begun > begun; }));
    reset ? gone.Reset() : gone.Close();
    EXPECT_EQ(handler_.NextRecord().status, kClientGone) << reset;
  }
}

TEST_F(ConnectionEnds, BroughtByTheServerAreNotTheClients) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/long"));
  handler_.WaitUntilWorking();
  server_.Stop();
  EXPECT_EQ(handler_.working, 0);
  EXPECT_EQ(handler_.NextRecord().status, 504);
}

}  // namespace
}  // namespace kdray::server
