// SPDX-License-Identifier: Apache-2.0
// The service without a socket: what it does around every handler, and what it asks before it reads
// a body.
#include "server/service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <variant>

#include "tests/support/fake_backend.h"
#include "tests/support/fake_peer.h"

namespace kdray::server {
namespace {

using nlohmann::json;
using test::FakeBackend;
using test::FakePeer;

class ServiceTest : public testing::Test {
 protected:
  explicit ServiceTest(ServiceOptions options = {})
      : service_(std::move(options), backend_, log_) {}

  HttpResponse Ask(std::string method, std::string target, HttpHeaders headers = {}) {
    FakePeer peer;
    return Ask(std::move(method), std::move(target), peer, std::move(headers));
  }
  HttpResponse Ask(std::string method, std::string target, FakePeer& peer,
                   HttpHeaders headers = {}) {
    HttpRequest request;
    request.method = std::move(method);
    request.path = target.substr(0, target.find('?'));
    if (target.find('?') != std::string::npos)
      request.query_string = target.substr(target.find('?') + 1);
    request.headers = std::move(headers);
    request.peer = &peer;
    return service_.Handle(request);
  }
  std::string Upload(const std::string& bytes) {
    FakePeer peer(bytes);
    return json::parse(Ask("POST", "/v1/trees", peer).body.text()).at("id");
  }
  static std::string Code(const HttpResponse& response) {
    return json::parse(response.body.text()).at("code");
  }
  static HttpHeaders Header(std::string_view name, std::string_view value) {
    HttpHeaders headers;
    headers.Add(name, value);
    return headers;
  }

  const Log log_{-1};
  FakeBackend backend_;
  Service service_;
};

class ServiceWithTokens : public ServiceTest {
 protected:
  ServiceWithTokens() : ServiceTest(Options()) {}
  static ServiceOptions Options() {
    ServiceOptions options;
    options.tokens = *BearerTokens::Parse("secret");
    return options;
  }
};

TEST_F(ServiceTest, EchoesARequestIdThatIsSane) {
  EXPECT_EQ(Ask("GET", "/healthz", Header("X-Request-Id", "a.B_9-")).headers.Find("X-Request-Id"),
            "a.B_9-");
  const std::string longest(64, 'x');
  EXPECT_EQ(Ask("GET", "/healthz", Header("X-Request-Id", longest)).headers.Find("X-Request-Id"),
            longest);
}

TEST_F(ServiceTest, MakesARequestIdInsteadOfAnyOther) {
  for (const std::string& given : {std::string(), std::string(65, 'x'), std::string("a b"),
                                   std::string("\""), std::string("\xc3\xa4")}) {
    const HttpResponse response = Ask("GET", "/healthz", Header("X-Request-Id", given));
    EXPECT_THAT(std::string(*response.headers.Find("X-Request-Id")),
                testing::MatchesRegex("[0-9a-f]{16}"));
  }
  EXPECT_NE(Ask("GET", "/healthz").headers.Find("X-Request-Id"),
            Ask("GET", "/healthz").headers.Find("X-Request-Id"));
}

TEST_F(ServiceTest, PutsTheCommonHeadersOnEveryAnswer) {
  for (const char* path : {"/healthz", "/nothing", "/v1/trees", "/v1/trees?x=1", "/"}) {
    const HttpResponse response = Ask("GET", path);
    EXPECT_EQ(response.headers.Find("Kdray-Version"), KDRAY_VERSION) << path;
    EXPECT_EQ(response.headers.Count("X-Request-Id"), 1U) << path;
    EXPECT_EQ(response.headers.Count("Cache-Control"), 1U) << path;
    EXPECT_THAT(std::string(*response.headers.Find("Server-Timing")),
                testing::StartsWith("queue;dur="))
        << path;
    EXPECT_EQ(response.headers.Find("X-Content-Type-Options"), "nosniff") << path;
  }
}

TEST_F(ServiceTest, TellsAProblemAsRfc9457Says) {
  const HttpResponse response = Ask("GET", "/v1/trees?limit=x", Header("X-Request-Id", "the-id"));
  EXPECT_EQ(response.status, 400);
  EXPECT_EQ(response.error_code, "invalid_parameter");
  EXPECT_EQ(response.headers.Find("Content-Type"), "application/problem+json");
  EXPECT_EQ(response.headers.Find("Cache-Control"), "no-store");
  const json problem = json::parse(response.body.text());
  EXPECT_EQ(problem.at("type"), "/problems/invalid_parameter");
  EXPECT_EQ(problem.at("status"), 400);
  EXPECT_EQ(problem.at("code"), "invalid_parameter");
  EXPECT_EQ(problem.at("request_id"), "the-id");
  EXPECT_EQ(problem.at("parameter"), "limit");
  EXPECT_FALSE(problem.at("title").get<std::string>().empty());
  EXPECT_FALSE(problem.at("detail").get<std::string>().empty());
}

TEST_F(ServiceTest, NamesTheMethodsThatAPathTakes) {
  const HttpResponse response = Ask("OPTIONS", "/v1/trees");
  EXPECT_EQ(response.status, 405);
  EXPECT_EQ(response.headers.Find("Allow"), "GET, HEAD, POST");
  EXPECT_EQ(Code(response), "method_not_allowed");
}

TEST_F(ServiceTest, TakesNoCodingThatItDoesNotKnow) {
  for (const char* coding :
       {"br", "deflate", "compress", "gzip, gzip", "gzip;q=1", "gz", "zstd,"}) {
    FakePeer peer("mesh");
    const HttpResponse response =
        Ask("POST", "/v1/trees", peer, Header("Content-Encoding", coding));
    EXPECT_EQ(Code(response), "unsupported_encoding") << coding;
    EXPECT_THAT(std::string(response.body.text()), testing::HasSubstr("gzip and zstd"));
    EXPECT_FALSE(peer.was_read());
  }
  HttpHeaders twice = Header("Content-Encoding", "identity");
  twice.Add("Content-Encoding", "gzip");
  EXPECT_EQ(Code(Ask("POST", "/v1/trees", twice)), "unsupported_encoding");
  FakePeer plain("mesh");
  EXPECT_EQ(Ask("POST", "/v1/trees", plain, Header("Content-Encoding", "identity")).status, 201);
}

TEST_F(ServiceTest, UndoesTheCodingOfUploadsAndOfNoOtherBody) {
  // The bytes of `printf mesh | gzip -n`.
  const std::string gzip(
      "\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\x03\xcb\x4d\x2d\xce\x00\x00\x56\x3a\x6f\xe1\x04\x00"
      "\x00\x00",
      24);
  const std::string id = Upload("mesh");
  for (const char* coding : {"gzip", "GZIP", "x-gzip"}) {
    FakePeer peer(gzip);
    const HttpResponse response =
        Ask("POST", "/v1/trees", peer, Header("Content-Encoding", coding));
    EXPECT_EQ(response.status, 200) << response.body.text();
    EXPECT_EQ(json::parse(response.body.text()).at("id"), id);
  }
  for (const char* path : {"/rays/closest", "/rays/any", "/render.png", "/render.npy"}) {
    FakePeer peer(gzip);
    const HttpResponse response =
        Ask("POST", "/v1/trees/" + id + path, peer, Header("Content-Encoding", "gzip"));
    EXPECT_EQ(Code(response), "unsupported_encoding") << path;
    EXPECT_FALSE(peer.was_read());
  }
}

TEST_F(ServiceTest, RefusesAMeshThatIsTooLargeBeforeItReadsAByte) {
  FakePeer peer;
  peer.Declare((std::uint64_t{1} << 30) + 1);
  const HttpResponse response = Ask("POST", "/v1/trees", peer);
  EXPECT_EQ(response.status, 413);
  EXPECT_EQ(Code(response), "mesh_too_large");
  const json problem = json::parse(response.body.text());
  EXPECT_EQ(problem.at("limit"), std::uint64_t{1} << 30);
  EXPECT_EQ(problem.at("actual"), (std::uint64_t{1} << 30) + 1);
  EXPECT_FALSE(peer.was_read());
}

TEST_F(ServiceTest, AsksTheStoreBeforeItReadsAByte) {
  backend_.upload_problem = api::Problem{.code = api::ErrorCode::kStoreFull, .detail = "full"};
  FakePeer peer("mesh");
  EXPECT_EQ(Ask("POST", "/v1/trees", peer).status, 507);
  EXPECT_FALSE(peer.was_read());
}

TEST_F(ServiceTest, LooksForTheTreeBeforeItReadsABatch) {
  for (const char* path : {"/rays/closest", "/rays/any", "/render.png", "/render.npy"}) {
    FakePeer peer(R"({"rays":[]})");
    EXPECT_EQ(Code(Ask("POST", "/v1/trees/x" + std::string(path), peer)), "tree_not_found");
    EXPECT_FALSE(peer.was_read()) << path;
  }
}

TEST_F(ServiceTest, ChecksParametersBeforeItReadsABody) {
  for (const char* target : {"/v1/trees?biuld=box", "/v1/trees/x/rays/closest?deadline=1",
                             "/v1/trees/x/rays/any?fields=t", "/v1/trees/x/render.png?width=1"}) {
    FakePeer peer("{}");
    EXPECT_EQ(Code(Ask("POST", target, peer)), "invalid_parameter") << target;
    EXPECT_FALSE(peer.was_read()) << target;
  }
}

TEST_F(ServiceTest, LimitsTheBodiesOfBatchesAndRenders) {
  const std::string id = Upload("mesh");
  FakePeer batch;
  batch.Declare(api::Limits{}.MaxBatchBytes() + 1);
  EXPECT_EQ(Code(Ask("POST", "/v1/trees/" + id + "/rays/any", batch)), "body_too_large");
  EXPECT_FALSE(batch.was_read());
  FakePeer render;
  render.Declare(api::Limits{}.max_json_body_bytes + 1);
  EXPECT_EQ(Code(Ask("POST", "/v1/trees/" + id + "/render.png", render)), "body_too_large");
  EXPECT_FALSE(render.was_read());
}

TEST_F(ServiceTest, TakesNoBodyWithAMeshThatItHas) {
  const std::string id = Upload("mesh");
  FakePeer peer("mesh");
  EXPECT_EQ(Code(Ask("POST", "/v1/trees?build=bvh&mesh=" + id.substr(0, 64), peer)),
            "malformed_request");
  EXPECT_EQ(Ask("POST", "/v1/trees?build=bvh&mesh=" + id.substr(0, 64)).status, 201);
}

TEST_F(ServiceTest, AnswersOnlyOpenPathsWhileItDrains) {
  EXPECT_EQ(Ask("GET", "/readyz").status, 200);
  service_.Drain();
  EXPECT_EQ(Ask("GET", "/healthz").status, 200);
  EXPECT_EQ(Ask("GET", "/").status, 200);
  EXPECT_EQ(Code(Ask("GET", "/readyz")), "draining");
  for (const char* path : {"/v1", "/v1/trees", "/v1/trees/x", "/docs"}) {
    const HttpResponse response = Ask("GET", path);
    EXPECT_EQ(response.status, 503) << path;
    EXPECT_EQ(Code(response), "draining") << path;
    EXPECT_EQ(response.headers.Find("Retry-After"),
              Ask("GET", "/readyz").headers.Find("Retry-After"));
    EXPECT_EQ(response.headers.Count("Retry-After"), 1U) << path;
  }
}

TEST_F(ServiceTest, StillAnswersTheConnectionsThatCameBeforeItDrains) {
  service_.Drain();
  FakePeer peer;
  HttpRequest request;
  request.method = "GET";
  request.path = "/v1";
  request.peer = &peer;
  EXPECT_EQ(service_.Handle(request).status, 503);
  request.came_before_drain = true;
  EXPECT_EQ(service_.Handle(request).status, 200);
}

TEST_F(ServiceTest, EveryProblemIsAnsweredWithStatusAndRetryAfterOfItsRow) {
  const std::string path = "/v1/trees/" + Upload("mesh") + "/cells?depth=1";
  for (const api::ErrorRow& row : api::ErrorTable()) {
    if (row.code == api::ErrorCode::kDraining) continue;  // only while it drains, see below
    backend_.query_problem = api::Problem{.code = row.code, .detail = "as told"};
    const HttpResponse response = Ask("GET", path);
    EXPECT_EQ(response.status, row.status);
    EXPECT_EQ(response.headers.Find("Retry-After").value_or("0"), std::to_string(row.retry_after_s))
        << api::Name(row.code);
  }
}

TEST_F(ServiceTest, SaysThatItDrainsOnlyWhenItDoes) {
  const std::string path = "/v1/trees/" + Upload("mesh") + "/cells?depth=1";
  backend_.query_problem = api::Problem{.code = api::ErrorCode::kDraining, .detail = "cancelled"};
  const HttpResponse response = Ask("GET", path);
  EXPECT_EQ(response.status, 500);
  EXPECT_EQ(Code(response), "internal");
  EXPECT_THAT(response.cause, testing::HasSubstr("cancelled"));
}

TEST_F(ServiceTest, CountsTheClientsThatLeft) {
  HttpRecord record;
  for (const int status : {200, kClientGone, 503, 504, kClientGone}) {
    record.status = status;
    service_.Answered(record);
  }
  EXPECT_EQ(service_.clients_gone(), 2U);
}

TEST_F(ServiceTest, CountsWhatItAnswersAndShowsIt) {
  const std::string id = Upload("mesh");
  FakePeer rays(R"({"rays":[[0,0,1,0,0,-1],[0,0,1,0,0,1]]})");
  EXPECT_EQ(Ask("POST", "/v1/trees/" + id + "/rays/any", rays).status, 200);
  HttpRecord record;
  record.route = Ask("GET", "/v1").route;
  record.status = 200;
  service_.Answered(record);
  record.route = Ask("GET", "/no/such/path").route;
  record.status = 404;
  service_.Answered(record);
  const HttpResponse response = Ask("GET", "/metrics");
  EXPECT_EQ(response.status, 200);
  EXPECT_EQ(response.headers.Find("Content-Type"), "text/plain; version=0.0.4; charset=utf-8");
  EXPECT_EQ(response.headers.Find("Cache-Control"), "no-store");
  const std::string text(response.body.text());
  for (const char* line : {"kdray_http_requests_total{route=\"/v1\",status=\"200\"} 1",
                           "kdray_http_requests_total{route=\"none\",status=\"404\"} 1",
                           "kdray_rays_total{precision=\"watertight\",query=\"any\"} 2",
                           "kdray_queue_wait_seconds_count 1", "kdray_tree_builds_total 7",
                           "kdray_running_requests 0"}) {
    EXPECT_THAT(text, testing::HasSubstr(std::string("\n") + line + "\n"));
  }
}

class ServiceWithCors : public ServiceTest {
 protected:
  ServiceWithCors() : ServiceTest(Options()) {}
  static ServiceOptions Options() {
    ServiceOptions options;
    options.tokens = *BearerTokens::Parse("secret");
    options.cors = std::get<CorsPolicy>(CorsPolicy::Parse("https://a.example,https://b.example"));
    return options;
  }
};

TEST_F(ServiceWithCors, LetsPagesReadRefusalsToo) {
  const HttpHeaders origin = Header("Origin", "https://b.example");
  const auto allowed = [](const HttpResponse& response) {
    return std::string(response.headers.Find("Access-Control-Allow-Origin").value_or(""));
  };
  for (const char* path : {"/healthz", "/v1", "/nowhere"}) {
    EXPECT_EQ(allowed(Ask("GET", path, origin)), "https://b.example") << path;
    EXPECT_EQ(allowed(Ask("GET", path)), "") << path;
  }
  HttpRequest request;
  request.headers = origin;
  const HttpResponse refused =
      service_.Refuse(request, {.code = api::ErrorCode::kOverloaded, .detail = "full"});
  EXPECT_EQ(allowed(refused), "https://b.example");
  EXPECT_THAT(std::string(*refused.headers.Find("Access-Control-Expose-Headers")),
              testing::HasSubstr("Retry-After"));
}

TEST_F(ServiceWithCors, AnswersAPreflightWithoutAToken) {
  HttpHeaders headers = Header("Origin", "https://a.example");
  EXPECT_EQ(Ask("OPTIONS", "/v1/trees", headers).status, 401);  // no preflight
  headers.Add("Access-Control-Request-Method", "POST");
  service_.Drain();
  const HttpResponse response = Ask("OPTIONS", "/v1/trees", headers);
  EXPECT_EQ(response.status, 204);
  EXPECT_EQ(response.headers.Find("Access-Control-Allow-Origin"), "https://a.example");
  EXPECT_EQ(response.headers.Find("Vary"), "Origin");
  EXPECT_EQ(response.headers.Count("Kdray-Version"), 1U);
  headers.Set("Origin", "https://c.example");
  EXPECT_EQ(Ask("OPTIONS", "/v1/trees", headers).status, 401);
}

TEST_F(ServiceTest, AnswersNoPreflightByDefault) {
  HttpHeaders headers = Header("Origin", "https://a.example");
  headers.Add("Access-Control-Request-Method", "POST");
  const HttpResponse response = Ask("OPTIONS", "/v1/trees", headers);
  EXPECT_EQ(response.status, 405);
  for (const auto& [name, value] : response.headers.fields()) {
    EXPECT_FALSE(name.starts_with("Access-Control")) << name;
  }
}

TEST_F(ServiceWithTokens, WantsATokenEverywhereButOnOpenPaths) {
  for (const Route& route : Routes()) {
    for (const char* method : {"GET", "POST", "DELETE", "OPTIONS"}) {
      FakePeer peer("body");
      const HttpResponse response = Ask(method, std::string(route.path), peer);
      if (route.open) {
        EXPECT_NE(response.status, 401) << method << route.path;
      } else {
        EXPECT_EQ(response.status, 401) << method << route.path;
        EXPECT_EQ(response.headers.Find("WWW-Authenticate"), "Bearer");
        EXPECT_FALSE(peer.was_read());
      }
    }
  }
  EXPECT_EQ(Ask("GET", "/no/such/path").status, 401);
}

TEST_F(ServiceWithTokens, TakesATokenThatItKnows) {
  EXPECT_EQ(Ask("GET", "/v1", Header("Authorization", "Bearer secret")).status, 200);
  EXPECT_EQ(Ask("GET", "/v1", Header("Authorization", "Bearer guess")).status, 401);
}

TEST_F(ServiceWithTokens, RefusesTwoTokensAtOnce) {
  HttpHeaders headers;
  headers.Add("Authorization", "Bearer secret");
  headers.Add("Authorization", "Bearer secret");
  EXPECT_EQ(Ask("GET", "/v1", headers).status, 401);
}

TEST_F(ServiceWithTokens, LetsNoSharedCacheKeepAnswers) {
  HttpHeaders headers = Header("Authorization", "Bearer secret");
  FakePeer peer("mesh");
  const std::string id = json::parse(Ask("POST", "/v1/trees", peer, headers).body.text()).at("id");
  for (const char* path : {"/mesh", "/render.png", "/cells?depth=1"}) {
    const HttpResponse response = Ask("GET", "/v1/trees/" + id + path, headers);
    EXPECT_EQ(response.status, 200) << path;
    EXPECT_THAT(std::string(*response.headers.Find("Cache-Control")),
                testing::StartsWith("private, max-age="))
        << path;
  }
}

}  // namespace
}  // namespace kdray::server
