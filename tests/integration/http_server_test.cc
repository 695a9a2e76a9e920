// SPDX-License-Identifier: Apache-2.0
// The adaptor on a real socket: requests, answers, refusals, clients that leave, and its end.
// http_server_limits_test.cc has its deadlines and its limit of connections.
#include "server/http/http_server.h"

#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "tests/integration/http_server_fixture.h"
#include "tests/support/raw_client.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using test::Ask;
using test::MakeRequest;
using test::RawClient;

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

}  // namespace
}  // namespace kdray::server
