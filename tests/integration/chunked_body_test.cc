// SPDX-License-Identifier: Apache-2.0
// Chunked bodies over a real socket: what is taken, what is refused, and that no byte of a refused
// body is taken for a request.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "tests/integration/service_over_http.h"
#include "tests/support/recording_handler.h"

namespace kdray::server {
namespace {

using namespace std::chrono_literals;
using test::MakeRequest;
using test::RawAnswer;
using test::RawClient;
using test::RunningService;

const std::string kPostChunked =
    "POST /echo HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\n\r\n";
const std::string kLastChunk = "0\r\n\r\n";

std::string Chunk(std::string_view data) {
  char size[20];
  std::snprintf(size, sizeof(size), "%zx\r\n", data.size());
  return size + std::string(data) + "\r\n";
}

/// `text` in chunks of `bytes` each, without the last one.
std::string Chunks(std::string_view text, std::size_t bytes) {
  std::string chunks;
  for (; !text.empty(); text.remove_prefix(std::min(bytes, text.size()))) {
    chunks += Chunk(text.substr(0, bytes));
  }
  return chunks;
}

/// Answers with the body. Refuses it from its third byte on at /small.
class EchoHandler final : public test::RecordingHandler {
 public:
  HttpResponse Handle(const HttpRequest& request) override {
    ++handled;
    HttpResponse response;
    if (request.path == "/unread") return response;
    std::string body;
    if (const auto problem = ReadBody(request, &body)) return Refuse(request, *problem);
    response.body = request.method + " " + body;
    return response;
  }

  std::atomic<int> handled{0};
};

class ChunkedBodies : public testing::Test {
 protected:
  ChunkedBodies() : server_(Options(), handler_) {
    const auto problem = server_.Bind();
    EXPECT_FALSE(problem) << *problem;
    server_.Start();
  }
  ~ChunkedBodies() override { server_.Stop(); }
  static HttpServerOptions Options() {
    HttpServerOptions options;
    options.port = 0;
    options.body_pace = {.grace = 300ms, .bytes_per_second = 100'000, .stall = 300ms};
    return options;
  }
  int port() const { return server_.port(); }

  EchoHandler handler_;
  HttpServer server_;
};

TEST_F(ChunkedBodies, AreJoinedAndTheConnectionIsKept) {
  RawClient client(port());
  const std::string text = "a body of some words, which come in pieces";
  for (const std::size_t bytes : {std::size_t{1}, std::size_t{5}, text.size()}) {
    ASSERT_TRUE(client.Send(kPostChunked + Chunks(text, bytes) + "0;last\r\nX-Sum: 1\r\n\r\n"));
    const auto answer = client.Read();
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->body, "POST " + text);
    EXPECT_EQ(answer->headers.count("connection"), 0U);
  }
  EXPECT_EQ(handler_.NextRecord().bytes_in, text.size());
}

TEST_F(ChunkedBodies, MayBeEmpty) {
  RawClient client(port());
  client.Send(kPostChunked + kLastChunk);
  EXPECT_EQ(client.Read()->body, "POST ");
  // Neither a length nor chunks: no body.
  client.Send("POST /echo HTTP/1.1\r\nHost: h\r\n\r\n");
  EXPECT_EQ(client.Read()->body, "POST ");
}

TEST_F(ChunkedBodies, MayBeLargeAndMixedWithRequestsThatFollowAtOnce) {
  std::string large(3'000'000, 'x');
  for (std::size_t i = 0; i < large.size(); ++i) large[i] = static_cast<char>('a' + i % 23);
  RawClient client(port());
  std::thread sender([&] {
    for (const std::size_t bytes : {std::size_t{1'000'000}, std::size_t{8192}, std::size_t{100}}) {
      client.Send(kPostChunked + Chunks(large, bytes) + kLastChunk +
                  MakeRequest("POST", "/echo", "between"));
    }
  });
  for (int i = 0; i < 3; ++i) {
    const auto answer = client.Read();
    ASSERT_TRUE(answer);
    EXPECT_TRUE(answer->body == "POST " + large) << i;
    EXPECT_EQ(client.Read()->body, "POST between");
  }
  sender.join();
}

TEST_F(ChunkedBodies, MayArriveByteByByte) {
  RawClient client(port());
  for (const char c : kPostChunked + "4;x=y\r\nslow\r\n0\r\nT: v\r\n\r\n") {
    ASSERT_TRUE(client.Send(std::string(1, c)));
    std::this_thread::sleep_for(1ms);  // real time: the server should find each byte alone
  }
  EXPECT_EQ(client.Read()->body, "POST slow");
}

TEST_F(ChunkedBodies, AreAskedForWhenTheyAreRead) {
  const std::string expecting =
      " HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\nExpect: 100-continue\r\n\r\n";
  RawClient client(port());
  client.Send("POST /echo" + expecting);
  EXPECT_EQ(client.Read()->status, 100);
  client.Send(Chunk("body") + kLastChunk);
  EXPECT_EQ(client.Read()->body, "POST body");
  client.Send("POST /unread" + expecting);
  const auto answer = client.Read();
  EXPECT_EQ(answer->status, 200);
  EXPECT_EQ(answer->Header("connection"), "close");  // whether the body comes is not known
}

TEST_F(ChunkedBodies, ThatAreMalformedEndTheConnectionWithoutAnotherRequest) {
  const std::string smuggled = "GET /smuggled HTTP/1.1\r\nHost: h\r\n\r\n";
  const std::string post = "POST /echo HTTP/1.1\r\nHost: h\r\n";
  const std::vector<std::pair<std::string, int>> cases = {
      {post + "Transfer-Encoding: chunked\r\nContent-Length: 5\r\n\r\n0\r\n\r\n", 400},
      {post + "Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400},
      {post + "Transfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n", 411},
      {post + "Transfer-Encoding: chunked, chunked\r\n\r\n0\r\n\r\n", 411},
      {post + "Transfer-Encoding: chunked\r\nTransfer-Encoding: x\r\n\r\n0\r\n\r\n", 411},
      {post + "Transfer-Encoding: identity\r\n\r\n", 411},
      {post + "Transfer-Encoding:\r\n chunked\r\n\r\n0\r\n\r\n", 400},
      {post + "X: y\r\n Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400},
      {"POST /echo HTTP/1.0\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400},
      {"GET /echo HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400},
      {kPostChunked + "+5\r\nhello\r\n0\r\n\r\n", 400},
      {kPostChunked + "-5\r\nhello\r\n0\r\n\r\n", 400},
      {kPostChunked + " 5\r\nhello\r\n0\r\n\r\n", 400},
      {kPostChunked + "5 \r\nhello\r\n0\r\n\r\n", 400},
      {kPostChunked + "0x5\r\nhello\r\n0\r\n\r\n", 400},
      {kPostChunked + "10000000000000005\r\nhello\r\n0\r\n\r\n", 400},
      {kPostChunked + "5\nhello\r\n0\r\n\r\n", 400},
      {kPostChunked + "5\r\nhello\n0\r\n\r\n", 400},
      {kPostChunked + "5\r\nhelloo\r\n0\r\n\r\n", 400},
      {kPostChunked + "4\r\nhello\r\n0\r\n\r\n", 400},
      {kPostChunked + "0\r\nX\r\n\r\n", 400},
      {kPostChunked + "0\n\n", 400},
      {kPostChunked + "0;" + std::string(5000, 'x') + "\r\n\r\n", 400},
      {kPostChunked + "0\r\n" + std::string(200, 'X') + ": " + std::string(9000, 'y') + "\r\n\r\n",
       400},
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
    EXPECT_LE(handler_.handled - before, 1) << request;
  }
}

TEST_F(ChunkedBodies, ThatEndEarlyAreMalformed) {
  for (const std::string body :
       {"", "5", "5\r\n", "5\r\nhel", "5\r\nhello", "5\r\nhello\r\n", "5\r\nhello\r\n0",
        "5\r\nhello\r\n0\r\n", "5\r\nhello\r\n0\r\nX: y\r\n"}) {
    RawClient client(port());
    client.Send(kPostChunked + body);
    client.ShutdownWrite();
    const auto answer = client.Read();
    ASSERT_TRUE(answer) << body;
    EXPECT_EQ(answer->body, "malformed_request") << body;
  }
}

TEST_F(ChunkedBodies, MustKeepThePaceWithTheirData) {
  // Extensions and small chunks earn no time.
  for (const std::string& drop : {std::string("x"), std::string("1;xxxxxxxx\r\na\r\n")}) {
    RawClient client(port());
    client.Send(kPostChunked + (drop.size() == 1 ? "1;" : ""));
    const auto start = std::chrono::steady_clock::now();
    std::optional<RawAnswer> answer;
    for (int i = 0; i < 200 && !answer; ++i) {
      client.Send(drop);
      answer = client.Read(20ms);
    }
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->body, "request_timeout");
    EXPECT_LT(std::chrono::steady_clock::now() - start, 3s);
  }
}

TEST_F(ServiceOverHttp, TakesChunkedBodiesEverywhere) {
  const auto chunked = [&](const std::string& path, std::string_view body,
                           const std::string& lines = "") {
    const auto answer = test::Ask(
        running_.port(), "POST " + path + " HTTP/1.1\r\nHost: h\r\n" + lines +
                             "Transfer-Encoding: chunked\r\n\r\n" + Chunks(body, 7) + kLastChunk);
    return answer.value_or(RawAnswer());
  };
  EXPECT_EQ(chunked("/v1/trees", "a mesh in chunks").status, 201);
  EXPECT_EQ(running_.Upload("a mesh in chunks").substr(0, 4),
            test::Json(chunked("/v1/trees", "a mesh in chunks"))
                .at("id")
                .get<std::string>()
                .substr(0, 4));
  for (const char* query : {"/rays/closest", "/rays/any"}) {
    const RawAnswer plain = running_.Ask("POST", Tree(query), kRays);
    const RawAnswer answer = chunked(Tree(query), kRays);
    EXPECT_EQ(answer.status, 200) << answer.body;
    EXPECT_EQ(answer.body, plain.body);
    const std::string npy = NpyRays(std::vector<float>(60, 1));
    EXPECT_EQ(chunked(Tree(query), npy).body, running_.Ask("POST", Tree(query), npy).body);
  }
  EXPECT_EQ(chunked(Tree("/render.png"), R"({"width":16})").status, 200);
  EXPECT_EQ(chunked(Tree("/tradeoff"), "").status, 200);
  EXPECT_EQ(RunningService::CodeOf(chunked(Tree("/tradeoff"), "x")), "malformed_request");
  const std::string mesh = "/v1/trees?mesh=" + Tree("").substr(10, 64);
  EXPECT_LT(chunked(mesh, "").status, 300);
  EXPECT_EQ(RunningService::CodeOf(chunked(mesh, "mesh")), "malformed_request");
  EXPECT_EQ(RunningService::CodeOf(chunked("/v1/trees", "")), "empty_mesh");
}

class NarrowService : public ServiceOverHttp {
 protected:
  NarrowService() : ServiceOverHttp(Narrow()) {}
  static ServiceOptions Narrow() {
    ServiceOptions options;
    options.limits.max_upload_bytes = 100;
    options.limits.max_rays = 1;
    return options;
  }
};

TEST_F(NarrowService, RefusesChunksAtTheFirstByteBeyondTheLimit) {
  const auto send = [&](RawClient& client, const std::string& path, const std::string& body) {
    client.Send("POST " + path + " HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\n\r\n" +
                body);
    return client.Read();
  };
  const std::uint64_t batch = running_.service().limits().MaxBatchBytes();
  const std::vector<std::tuple<std::string, std::uint64_t, std::string>> routes = {
      {"/v1/trees", 100, "mesh_too_large"},
      {Tree("/rays/any"), batch, "body_too_large"},
      {Tree("/render.png"), 1 << 20, "body_too_large"}};
  for (const auto& [path, limit, code] : routes) {
    RawClient client(running_.port());
    // The client has sent neither the rest of the chunk nor a last one.
    const std::string size = "fffffff\r\n";
    const auto refused = send(client, path, size + std::string(limit + 1, ' '));
    ASSERT_TRUE(refused) << path;
    EXPECT_EQ(RunningService::CodeOf(*refused), code);
    EXPECT_EQ(refused->status, 413);
    EXPECT_EQ(test::Json(*refused).at("limit"), limit);
    EXPECT_TRUE(client.IsClosed(5s));
    RawClient other(running_.port());
    const auto taken = send(other, path, Chunk(std::string(limit, ' ')) + kLastChunk);
    ASSERT_TRUE(taken) << path;
    EXPECT_NE(taken->status, 413) << path;
  }
}

TEST_F(ServiceOverHttp, ChecksTheStoreBeforeAChunkedBodyIsAskedFor) {
  backend_.upload_problem = api::Problem{.code = api::ErrorCode::kStoreFull, .detail = "full"};
  RawClient client(running_.port());
  client.Send(
      "POST /v1/trees HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\nExpect: "
      "100-continue\r\n\r\n");
  EXPECT_EQ(client.Read()->status, 507);
  EXPECT_TRUE(client.IsClosed(5s));
}

TEST_F(ServiceOverHttp, ChargesAChunkedBodyAsItArrives) {
  RawClient slow(running_.port());
  slow.Send("POST " + Tree("/rays/any") +
            " HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\n\r\nfffffffffffffff\r\n{\"rays");
  WaitFor([&] { return running_.service().request_memory_used() == 6; });
  EXPECT_EQ(running_.Ask("POST", Tree("/rays/any"), kRays).status, 200);
  slow.Close();
  WaitFor([&] { return running_.service().request_memory_used() == 0; });
}

}  // namespace
}  // namespace kdray::server
