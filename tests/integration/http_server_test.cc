// SPDX-License-Identifier: Apache-2.0
// The adaptor on a real socket, with a handler that tells what reached it.
#include "server/http/http_server.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/raw_client.h"
#include "tests/support/recording_handler.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using api::ErrorCode;
using test::Ask;
using test::MakeRequest;
using test::RawClient;

/// Answers 200 with `METHOD path body`; some paths do something else.
class EchoHandler final : public test::RecordingHandler {
 public:
  HttpResponse Handle(const HttpRequest& request) override {
    ++handled;
    HttpResponse response;
    if (request.path == "/throw") throw std::runtime_error("secret /etc/x");
    if (request.path == "/throw-other") throw 42;
    if (request.path == "/throw-memory") throw std::bad_alloc();
    if (request.path == "/throw-always") {
      throws_always = true;
      throw std::runtime_error("secret");
    }
    if (request.path == "/throw-in-body") {
      response.body = HttpBody::Streamed(100, [](std::uint64_t, std::span<std::byte>) -> bool {
        throw std::runtime_error("secret");
      });
      return response;
    }
    if (request.path == "/empty") {
      response.status = 204;
      return response;
    }
    if (request.path == "/refuse-unread") {
      response.status = 413;
      return response;
    }
    if (request.path == "/large") {
      response.body = std::string(8 << 20, 'x');
      return response;
    }
    if (request.path == "/streamed") {
      response.body =
          HttpBody::Streamed(300'000, [](std::uint64_t offset, std::span<std::byte> out) {
            for (std::size_t i = 0; i < out.size(); ++i) {
              out[i] = static_cast<std::byte>('a' + (offset + i) % 26);
            }
            return true;
          });
      return response;
    }
    if (request.path == "/pieces") {
      std::vector<api::ByteBlock> pieces;
      char next = 'a';
      for (std::size_t left = 300'000, size = 1; left > 0; left -= size) {
        size = std::min(3 * size + 1, left);
        pieces.emplace_back(size);
        for (std::size_t i = 0; i < size; ++i) {
          pieces.back().data()[i] = next;
          next = next == 'z' ? 'a' : static_cast<char>(next + 1);
        }
      }
      response.body = HttpBody(std::move(pieces), nullptr);
      return response;
    }
    if (request.path == "/wait") WorkUntilLetGo(request);
    std::string text = request.method + " " + request.path + " ";
    if (const auto problem = ReadBody(request, &text)) return Refuse(request, *problem);
    response.body = std::move(text);
    response.headers.Add("Content-Type", "text/plain");
    response.headers.Add("X-Split", "a\r\nSet-Cookie: b");
    return response;
  }

  void ConnectionDropped(DropReason reason) noexcept override {
    ++(reason == DropReason::kEvicted ? evicted : refused);
  }

  HttpResponse Refuse(const HttpRequest& request, const api::Problem& problem) override {
    if (throws_always.exchange(false)) throw std::logic_error("secret");
    return RecordingHandler::Refuse(request, problem);
  }

  std::atomic<bool> throws_always{false};
  std::atomic<int> handled{0};
  std::atomic<int> evicted{0}, refused{0};
};

class HttpServerTest : public testing::Test {
 protected:
  explicit HttpServerTest(HttpServerOptions options = {})
      : server_(WithFreePort(options), handler_) {
    const auto problem = server_.Bind();
    EXPECT_FALSE(problem) << *problem;
    server_.Start();
  }
  ~HttpServerTest() override {
    handler_.let_go = true;
    server_.Stop();
  }
  static HttpServerOptions WithFreePort(HttpServerOptions options) {
    options.port = 0;
    return options;
  }
  int port() const { return server_.port(); }

  EchoHandler handler_;
  HttpServer server_;
};

/// Deadlines that a test can wait for.
class ImpatientHttpServer : public HttpServerTest {
 protected:
  ImpatientHttpServer() : HttpServerTest(Impatient()) {}
  static HttpServerOptions Impatient() {
    HttpServerOptions options;
    options.head_timeout = 200ms;
    options.idle_timeout = 200ms;
    options.body_pace = {.grace = 200ms, .bytes_per_second = 100'000, .stall = 200ms};
    options.answer_pace = options.body_pace;
    return options;
  }
};

class CrowdedHttpServer : public HttpServerTest {
 protected:
  CrowdedHttpServer() : HttpServerTest(Crowded()) {}
  static HttpServerOptions Crowded() {
    HttpServerOptions options;
    options.max_connections = 2;
    return options;
  }
};

TEST_F(HttpServerTest, AnswersARequestAndKeepsTheConnection) {
  RawClient client(port());
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(client.Send(MakeRequest("POST", "/echo", "body" + std::to_string(i))));
    const auto answer = client.Read();
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->body, "POST /echo body" + std::to_string(i));
    EXPECT_EQ(answer->Header("content-type"), "text/plain");
    EXPECT_EQ(answer->headers.count("connection"), 0U);
    EXPECT_EQ(answer->Header("date").size(), 29U);
  }
}

TEST_F(HttpServerTest, AnswersPipelinedRequestsInOrder) {
  RawClient client(port());
  std::string requests;
  for (int i = 0; i < 20; ++i) {
    requests += MakeRequest("POST", "/" + std::to_string(i), std::string(100 * i + 1, 'x'));
  }
  ASSERT_TRUE(client.Send(requests));
  for (int i = 0; i < 20; ++i) {
    const auto answer = client.Read();
    ASSERT_TRUE(answer) << i;
    EXPECT_EQ(answer->body, "POST /" + std::to_string(i) + " " + std::string(100 * i + 1, 'x'));
  }
}

TEST_F(HttpServerTest, ReadsARequestThatArrivesByteByByte) {
  RawClient client(port());
  for (const char c : MakeRequest("POST", "/echo", "slow")) {
    ASSERT_TRUE(client.Send(std::string(1, c)));
    std::this_thread::sleep_for(1ms);  // real time: the server should find each byte alone
  }
  EXPECT_EQ(client.Read()->body, "POST /echo slow");
}

TEST_F(HttpServerTest, AnswersHeadWithTheLengthAndNoBody) {
  RawClient client(port());
  client.Send(MakeRequest("HEAD", "/streamed"));
  const auto head = client.Read(10s, true);
  ASSERT_TRUE(head);
  EXPECT_EQ(head->Header("content-length"), "300000");
  EXPECT_EQ(head->headers.count("accept-ranges"), 0U);
  client.Send(MakeRequest("GET", "/echo"));
  EXPECT_EQ(client.Read()->body, "GET /echo ");
}

TEST_F(HttpServerTest, StreamsABodyPieceByPiece) {
  const auto answer = Ask(port(), MakeRequest("GET", "/streamed"));
  ASSERT_TRUE(answer);
  ASSERT_EQ(answer->body.size(), 300'000U);
  for (std::size_t i = 0; i < answer->body.size(); ++i) {
    ASSERT_EQ(answer->body[i], static_cast<char>('a' + i % 26)) << i;
  }
}

TEST_F(HttpServerTest, SendsTheBytesOfManyPiecesInOrder) {
  const auto answer = Ask(port(), MakeRequest("GET", "/pieces"));
  ASSERT_TRUE(answer);
  ASSERT_EQ(answer->body.size(), 300'000U);
  for (std::size_t i = 0; i < answer->body.size(); ++i) {
    ASSERT_EQ(answer->body[i], static_cast<char>('a' + i % 26)) << i;
  }
  EXPECT_EQ(Ask(port(), MakeRequest("HEAD", "/pieces"), true)->Header("content-length"), "300000");
}

TEST_F(HttpServerTest, SendsNoLengthWith204) {
  const auto answer = Ask(port(), MakeRequest("GET", "/empty"));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 204);
  EXPECT_EQ(answer->headers.count("content-length"), 0U);
}

TEST_F(HttpServerTest, IgnoresRangesAndCompressesNothing) {
  const auto answer = Ask(
      port(),
      MakeRequest("GET", "/streamed", "", "Range: bytes=0-1,5-6\r\nAccept-Encoding: br, gzip\r\n"));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200);
  EXPECT_EQ(answer->body.size(), 300'000U);
  EXPECT_EQ(answer->headers.count("content-encoding"), 0U);
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/echo", "", "Range: nonsense\r\n"))->status, 200);
}

TEST_F(HttpServerTest, SendsNoHeaderThatHoldsALineBreak) {
  const auto answer = Ask(port(), MakeRequest("GET", "/echo"));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->headers.count("x-split") + answer->headers.count("set-cookie"), 0U);
}

TEST_F(HttpServerTest, HidesWhatAHandlerThrows) {
  for (const char* path : {"/throw", "/throw-other"}) {
    const auto answer = Ask(port(), MakeRequest("GET", path));
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->status, 500);
    EXPECT_EQ(answer->body, "internal");
    EXPECT_EQ(answer->headers.count("exception_what"), 0U);
  }
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/throw-memory"))->body, "memory_full");
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/echo"))->status, 200);
  EXPECT_EQ(handler_.RecordOf("/throw").cause, "secret /etc/x");
}

TEST_F(HttpServerTest, OutlivesAHandlerThatThrowsWhileItRefuses) {
  const auto answer = Ask(port(), MakeRequest("GET", "/throw-always"));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 500);
  EXPECT_EQ(answer->body, "");
  EXPECT_EQ(answer->headers.count("exception_what"), 0U);
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/echo"))->status, 200);
}

TEST_F(HttpServerTest, BreaksAnAnswerOffWhenItsBodyThrows) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/throw-in-body"));
  EXPECT_FALSE(client.Read());
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/echo"))->status, 200);
  EXPECT_FALSE(handler_.RecordOf("/throw-in-body").complete);
}

TEST_F(HttpServerTest, RefusesAndClosesWithoutTakingBodyBytesForARequest) {
  const std::string smuggled = "GET /smuggled HTTP/1.1\r\nHost: h\r\n\r\n";
  const std::vector<std::pair<std::string, int>> cases = {
      {"POST / HTTP/1.1\r\nHost: h\r\nContent-Length: 4\r\nTransfer-Encoding: "
       "chunked\r\n\r\n0\r\n\r\n",
       400},
      {"POST / HTTP/1.1\r\nHost: h\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n", 400},
      {"POST / HTTP/1.1\r\nHost: h\r\nContent-Length: -1\r\n\r\n", 400},
      {"POST / HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n", 411},
      {"GET / HTTP/1.1\r\nHost: h\r\nContent-Length: 36\r\n\r\n", 400},
      {"GET / HTTP/1.1\nHost: h\n\n", 400},
      {"GET / HTTP/1.1\r\nHost: h\r\nX: y\n\r\n", 400},
      {"nonsense\r\n\r\n", 400},
      {"POST /refuse-unread HTTP/1.1\r\nHost: h\r\nContent-Length: 1000\r\n\r\n", 413},
  };
  for (const auto& [request, status] : cases) {
    const int before = handler_.handled;
    RawClient client(port());
    client.Send(request + smuggled);
    const auto answer = client.Read();
    ASSERT_TRUE(answer) << request;
    EXPECT_EQ(answer->status, status) << request;
    EXPECT_EQ(answer->Header("connection"), "close") << request;
    EXPECT_FALSE(client.Read(2s)) << request;
    EXPECT_LE(handler_.handled - before, request.find("refuse-unread") == std::string::npos ? 0 : 1)
        << request;
  }
}

TEST_F(HttpServerTest, RefusesHeadsThatAreTooLarge) {
  EXPECT_EQ(Ask(port(), "GET /" + std::string(8192, 'a') + " HTTP/1.1\r\nHost: h\r\n\r\n")->body,
            "uri_too_long");
  EXPECT_EQ(Ask(port(), "GET /" + std::string(100'000, 'a'))->body, "uri_too_long");
  EXPECT_EQ(
      Ask(port(), MakeRequest("GET", "/", "", "X: " + std::string(40'000, 'a') + "\r\n"))->body,
      "headers_too_large");
  std::string lines;
  for (int i = 0; i < 100; ++i) lines += "X: y\r\n";
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/", "", lines))->body, "headers_too_large");
  EXPECT_EQ(handler_.handled, 0);
}

TEST_F(HttpServerTest, StopsReadingAHeadThatNeverEnds) {
  RawClient client(port());
  const std::string line = "X: " + std::string(1000, 'y') + "\r\n";
  client.Send("GET / HTTP/1.1\r\nHost: h\r\n");
  std::size_t sent = 0;
  while (sent < (std::size_t{64} << 20) && client.Send(line)) sent += line.size();
  EXPECT_LT(sent, std::size_t{16} << 20);  // what sockets buffer, at most
}

TEST_F(HttpServerTest, TellsAClientToGoOnOnlyWhenTheBodyIsWanted) {
  RawClient client(port());
  client.Send(
      "POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: 4\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_EQ(client.Read()->status, 100);
  client.Send("body");
  EXPECT_EQ(client.Read()->body, "POST /echo body");
  client.Send(
      "POST /refuse-unread HTTP/1.1\r\nHost: h\r\nContent-Length: 4\r\nExpect: "
      "100-continue\r\n\r\n");
  EXPECT_EQ(client.Read()->status, 413);
  EXPECT_TRUE(client.IsClosed(5s));
}

TEST_F(HttpServerTest, ClosesWhenTheClientAsksForIt) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/echo", "", "Connection: close\r\n"));
  EXPECT_EQ(client.Read()->Header("connection"), "close");
  EXPECT_TRUE(client.IsClosed(5s));
  RawClient old(port());
  old.Send("GET /echo HTTP/1.0\r\n\r\n");
  EXPECT_EQ(old.Read()->status, 200);
  EXPECT_TRUE(old.IsClosed(5s));
}

TEST_F(HttpServerTest, TellsAClientOfHttp10WhetherItsConnectionIsKept) {
  RawClient old(port());
  for (int i = 0; i < 3; ++i) {
    old.Send("GET /echo HTTP/1.0\r\nConnection: keep-alive\r\n\r\n");
    const auto answer = old.Read();
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->Header("connection"), "keep-alive");
  }
  old.Send("GET /refuse-unread HTTP/1.0\r\nConnection: keep-alive\r\n\r\n");
  EXPECT_EQ(old.Read()->Header("connection"), "close");
  EXPECT_TRUE(old.IsClosed(5s));
}

TEST_F(HttpServerTest, SaysSoWhenABodyEndsEarly) {
  RawClient client(port());
  client.Send("POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: 10\r\n\r\nhalf");
  client.ShutdownWrite();
  EXPECT_EQ(client.Read()->body, "malformed_request");
}

TEST_F(HttpServerTest, AnswersAClientThatHasClosedItsSendingSide) {
  RawClient client(port());
  client.Send(MakeRequest("POST", "/echo", "all of it"));
  client.ShutdownWrite();
  EXPECT_EQ(client.Read()->body, "POST /echo all of it");
}

TEST_F(HttpServerTest, CancelsTheWorkOfAClientThatLeaves) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/wait"));
  handler_.WaitUntilWorking();
  const auto left = std::chrono::steady_clock::now();
  client.Close();
  handler_.WaitUntilWorking(0);
  EXPECT_LT(std::chrono::steady_clock::now() - left, 250ms);
}

TEST_F(HttpServerTest, SurvivesAClientThatLeavesInTheMiddleOfAnAnswer) {
  for (int i = 0; i < 5; ++i) {
    RawClient client(port());
    client.Send(MakeRequest("GET", "/large"));
    ASSERT_TRUE(client.WaitForBytes());
    client.Close();
  }
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/echo"))->status, 200);
}

TEST_F(HttpServerTest, RefusesToShareItsPort) {
  HttpServerOptions options;
  options.port = port();
  HttpServer second(options, handler_);
  const auto problem = second.Bind();
  ASSERT_TRUE(problem);
  EXPECT_NE(problem->find(std::to_string(port())), std::string::npos);
  EXPECT_NE(problem->find("in use"), std::string::npos) << *problem;
}

TEST_F(HttpServerTest, ServesManyClientsAtOnce) {
  std::vector<std::future<int>> answers;
  for (int i = 0; i < 50; ++i) {
    answers.push_back(std::async(std::launch::async, [this, i] {
      int good = 0;
      RawClient client(port());
      for (int j = 0; j < 20; ++j) {
        const std::string body = std::to_string(i * 1000 + j);
        client.Send(MakeRequest("POST", "/echo", body));
        const auto answer = client.Read();
        good += answer && answer->body == "POST /echo " + body ? 1 : 0;
      }
      return good;
    }));
  }
  for (auto& answer : answers) EXPECT_EQ(answer.get(), 20);
}

TEST_F(HttpServerTest, RecordsEveryAnswerOnce) {
  Ask(port(), MakeRequest("POST", "/echo", "12345"));
  Ask(port(), "nonsense\r\n\r\n");
  server_.Stop();
  // In either order: an answer is recorded after it was sent, by the thread of its connection.
  const std::vector<HttpRecord> records = handler_.Records();
  ASSERT_EQ(records.size(), 2U);
  const bool echo_first = records[0].status == 200;
  const HttpRecord& echo = records[echo_first ? 0 : 1];
  const HttpRecord& refused = records[echo_first ? 1 : 0];
  EXPECT_EQ(echo.method, "POST");
  EXPECT_EQ(echo.path, "/echo");
  EXPECT_EQ(echo.status, 200);
  EXPECT_EQ(echo.bytes_in, 5U);
  EXPECT_GT(echo.bytes_out, 5U);
  EXPECT_TRUE(echo.complete);
  EXPECT_EQ(echo.remote_addr, "127.0.0.1");
  EXPECT_EQ(refused.status, 400);
  EXPECT_EQ(refused.error_code, "malformed_request");
}

TEST_F(HttpServerTest, FinishesWhatIsUnderWayWhenItDrains) {
  RawClient idle(port());
  idle.Send(MakeRequest("GET", "/echo"));
  ASSERT_TRUE(idle.Read());
  RawClient busy(port());
  busy.Send(MakeRequest("GET", "/wait"));
  handler_.WaitUntilWorking();

  server_.Drain();
  EXPECT_TRUE(idle.IsClosed(5s));
  EXPECT_FALSE(server_.WaitUntilIdle(std::chrono::steady_clock::now() + 50ms));
  const auto late = Ask(port(), MakeRequest("GET", "/echo"));
  ASSERT_TRUE(late);
  EXPECT_EQ(late->Header("connection"), "close");

  handler_.let_go = true;
  const auto answer = busy.Read();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->body, "GET /wait ");
  EXPECT_EQ(answer->Header("connection"), "close");
  EXPECT_TRUE(server_.WaitUntilIdle(std::chrono::steady_clock::now() + 5s));
}

TEST_F(HttpServerTest, StopsWithoutWaitingForClients) {
  RawClient silent(port());
  RawClient half(port());
  half.Send("POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: 10\r\n\r\nhalf");
  RawClient working(port());
  working.Send(MakeRequest("GET", "/wait"));
  handler_.WaitUntilWorking();
  const auto start = std::chrono::steady_clock::now();
  server_.Stop();
  EXPECT_LT(std::chrono::steady_clock::now() - start, 2s);
}

TEST_F(ImpatientHttpServer, CutsAHeadThatDribbles) {
  RawClient client(port());
  const auto start = std::chrono::steady_clock::now();
  std::optional<test::RawAnswer> answer;
  for (const char c : MakeRequest("GET", "/echo", "", "X: " + std::string(100, 'y') + "\r\n")) {
    client.Send(std::string(1, c));
    if ((answer = client.Read(20ms))) break;
  }
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->body, "request_timeout");
  EXPECT_EQ(answer->status, 408);
  EXPECT_LT(std::chrono::steady_clock::now() - start, 1s);
}

TEST_F(ImpatientHttpServer, CutsABodyThatDribbles) {
  RawClient client(port());
  client.Send("POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: 100000\r\n\r\n");
  std::optional<test::RawAnswer> answer;
  for (int i = 0; i < 100 && !answer; ++i) {
    client.Send("x");
    answer = client.Read(20ms);
  }
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->body, "request_timeout");
}

TEST_F(ImpatientHttpServer, LetsABodyTakeItsTimeWhileItKeepsThePace) {
  // 60 kB at 100 kB/s: some 600 ms, three times the grace.
  RawClient client(port());
  client.Send("POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: 60000\r\n\r\n");
  for (int i = 0; i < 12; ++i) {
    client.Send(std::string(5000, 'x'));
    std::this_thread::sleep_for(45ms);  // real time: the pace is what is tested
  }
  const auto answer = client.Read();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->body.size(), 60'000 + std::string_view("POST /echo ").size());
}

TEST_F(ImpatientHttpServer, ClosesAConnectionThatSaysNothing) {
  RawClient silent(port());
  EXPECT_TRUE(silent.IsClosed(2s));
  RawClient idle(port());
  idle.Send(MakeRequest("GET", "/echo"));
  ASSERT_TRUE(idle.Read());
  EXPECT_TRUE(idle.IsClosed(2s));
  EXPECT_EQ(handler_.Records().size(), 1U);
}

TEST_F(ImpatientHttpServer, GivesUpOnAClientThatDoesNotRead) {
  RawClient client(port());
  client.Send(MakeRequest("GET", "/large"));
  EXPECT_FALSE(handler_.RecordOf("/large").complete);
}

TEST_F(CrowdedHttpServer, ClosesTheLongestIdleConnectionToLetANewOneIn) {
  RawClient first(port()), second(port());
  first.Send(MakeRequest("GET", "/echo"));
  ASSERT_TRUE(first.Read());
  // Real time: a connection counts as idle a moment after its answer, which nothing tells.
  std::this_thread::sleep_for(20ms);
  second.Send(MakeRequest("GET", "/echo"));
  ASSERT_TRUE(second.Read());
  std::this_thread::sleep_for(20ms);
  RawClient third(port());
  third.Send(MakeRequest("GET", "/third"));
  EXPECT_EQ(third.Read()->body, "GET /third ");
  EXPECT_TRUE(first.IsClosed(2s));
  second.Send(MakeRequest("GET", "/echo"));
  EXPECT_TRUE(second.Read());
}

TEST_F(CrowdedHttpServer, ClosesTheSlowestHeadToLetANewOneIn) {
  RawClient first(port()), second(port());
  first.Send("GET /echo HTTP/1.1\r\nHo");
  std::this_thread::sleep_for(30ms);  // real time: slow is what has begun long ago
  second.Send("GET /echo HTTP/1.1\r\nHo");
  std::this_thread::sleep_for(30ms);
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/third"))->body, "GET /third ");
  EXPECT_TRUE(first.IsClosed(2s));
  second.Send("st: h\r\n\r\n");
  EXPECT_EQ(second.Read()->body, "GET /echo ");
  EXPECT_EQ(handler_.evicted, 1);
}

TEST_F(CrowdedHttpServer, ClosesTheLatestBodyToLetANewOneIn) {
  RawClient first(port()), second(port());
  for (RawClient* client : {&first, &second}) {
    client->Send("POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: 8\r\n\r\nhalf");
    std::this_thread::sleep_for(400ms);  // real time: late is what has been slow for half a second
  }
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/third"))->body, "GET /third ");
  EXPECT_TRUE(first.IsClosed(2s));
  second.Send("half");
  EXPECT_EQ(second.Read()->body, "POST /echo halfhalf");
}

TEST_F(CrowdedHttpServer, ClosesAReaderThatDoesNotReadToLetANewOneIn) {
  RawClient first(port()), second(port());
  for (RawClient* client : {&first, &second}) client->Send(MakeRequest("GET", "/large"));
  std::this_thread::sleep_for(700ms);  // real time: late is what has been slow for half a second
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/third"))->body, "GET /third ");
  EXPECT_EQ(handler_.evicted, 1);
}

TEST_F(CrowdedHttpServer, RefusesAtOnceWhenEveryConnectionIsBusy) {
  RawClient first(port()), second(port());
  for (RawClient* client : {&first, &second}) {
    client->Send(MakeRequest("GET", "/wait"));
    handler_.WaitUntilWorking(client == &first ? 1 : 2);
  }
  for (int i = 0; i < 5; ++i) {
    const auto start = std::chrono::steady_clock::now();
    const auto answer = Ask(port(), MakeRequest("GET", "/echo"));
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->status, 503);
    EXPECT_EQ(answer->body, "overloaded");
    EXPECT_LT(std::chrono::steady_clock::now() - start, 500ms);
  }
  EXPECT_EQ(handler_.refused, 5);
  handler_.let_go = true;
  EXPECT_TRUE(first.Read());
  EXPECT_TRUE(second.Read());
  EXPECT_EQ(Ask(port(), MakeRequest("GET", "/echo"))->status, 200);
}

}  // namespace
}  // namespace kdray::server
