// SPDX-License-Identifier: Apache-2.0
// The deadlines of the adaptor, and its limit of connections.
#include <gtest/gtest.h>

#include <chrono>
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
