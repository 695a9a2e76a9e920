// SPDX-License-Identifier: Apache-2.0
#include "server/cors.h"

#include <gtest/gtest.h>

#include <string>

namespace kdray::server {
namespace {

CorsPolicy Allowing(std::string_view list) {
  auto parsed = CorsPolicy::Parse(list);
  if (const auto* problem = std::get_if<std::string>(&parsed)) ADD_FAILURE() << list << *problem;
  return std::get<CorsPolicy>(std::move(parsed));
}

HttpRequest From(std::string_view origin, std::string method = "GET") {
  HttpRequest request;
  request.method = std::move(method);
  request.headers.Add("Host", "h");
  if (!origin.empty()) request.headers.Add("Origin", origin);
  return request;
}

HttpRequest Preflight(std::string_view origin) {
  HttpRequest request = From(origin, "OPTIONS");
  request.headers.Add("Access-Control-Request-Method", "POST");
  return request;
}

/// Access-Control-Allow-Origin of the answer to `request`; "" without it.
std::string Allowed(const CorsPolicy& policy, const HttpRequest& request) {
  HttpResponse response;
  policy.AddHeaders(request, response);
  return std::string(response.headers.Find("Access-Control-Allow-Origin").value_or(""));
}

TEST(CorsPolicy, AllowsNobodyByDefaultAndAddsNothing) {
  HttpResponse response;
  CorsPolicy().AddHeaders(From("https://a.example"), response);
  EXPECT_TRUE(response.headers.fields().empty());
  EXPECT_FALSE(CorsPolicy().AnswerPreflight(Preflight("https://a.example")));
}

TEST(CorsPolicy, NamesTheOriginThatAskedIfItIsInTheList) {
  const CorsPolicy policy = Allowing("https://a.example, http://localhost:3000");
  for (const char* origin : {"https://a.example", "http://localhost:3000"}) {
    EXPECT_EQ(Allowed(policy, From(origin)), origin);
  }
  for (const char* origin :
       {"http://a.example", "https://b.example", "https://a.example:8443", "https://xa.example",
        "https://a.example.evil", "http://localhost", "null", "*", "https://a.example/", ""}) {
    EXPECT_EQ(Allowed(policy, From(origin)), "") << origin;
  }
  HttpRequest twice = From("https://a.example");
  twice.headers.Add("Origin", "https://b.example");
  EXPECT_EQ(Allowed(policy, twice), "");
}

TEST(CorsPolicy, TellsCachesThatTheAnswerDependsOnTheOrigin) {
  const CorsPolicy policy = Allowing("https://a.example");
  for (const char* origin : {"https://a.example", "https://b.example", ""}) {
    HttpResponse response;
    response.headers.Add("Vary", "Accept");
    policy.AddHeaders(From(origin), response);
    EXPECT_EQ(response.headers.Find("Vary"), "Accept, Origin") << origin;
    EXPECT_EQ(response.headers.Count("Vary"), 1U);
  }
}

TEST(CorsPolicy, NeverAllowsCredentialsToEverybody) {
  HttpResponse response;
  Allowing("*").AddHeaders(From("https://a.example"), response);
  EXPECT_EQ(response.headers.Find("Access-Control-Allow-Origin"), "*");
  EXPECT_FALSE(response.headers.Find("Access-Control-Allow-Credentials"));
  EXPECT_FALSE(response.headers.Find("Vary"));
  HttpResponse listed;
  Allowing("https://a.example").AddHeaders(From("https://a.example"), listed);
  EXPECT_EQ(listed.headers.Find("Access-Control-Allow-Credentials"), "true");
}

TEST(CorsPolicy, LetsThePageReadOurHeaders) {
  HttpResponse response;
  for (const char* name : {"Content-Type", "Kdray-Precision", "ETag", "X-Content-Type-Options",
                           "Kdray-Added-Later", "Server-Timing", "Location"}) {
    response.headers.Add(name, "x");
  }
  Allowing("*").AddHeaders(From("https://a.example"), response);
  EXPECT_EQ(response.headers.Find("Access-Control-Expose-Headers"),
            "Kdray-Precision, ETag, Kdray-Added-Later, Server-Timing, Location");
}

TEST(CorsPolicy, AnswersPreflightsOfAllowedOriginsAlone) {
  const CorsPolicy policy = Allowing("https://a.example");
  const auto answer = policy.AnswerPreflight(Preflight("https://a.example"));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 204);
  EXPECT_EQ(answer->headers.Find("Access-Control-Allow-Methods"), "GET, HEAD, POST, DELETE");
  EXPECT_NE(answer->headers.Find("Access-Control-Allow-Headers")->find("Authorization"),
            std::string::npos);
  EXPECT_NE(answer->headers.Find("Access-Control-Allow-Headers")->find("Traceparent"),
            std::string::npos)
      << "tracing in a page adds it to every request";
  EXPECT_EQ(answer->headers.Find("Access-Control-Max-Age"), "7200");
  EXPECT_FALSE(policy.AnswerPreflight(Preflight("https://b.example")));
  EXPECT_FALSE(policy.AnswerPreflight(From("https://a.example", "OPTIONS")));
  EXPECT_FALSE(policy.AnswerPreflight(Preflight("")));
  HttpRequest post = Preflight("https://a.example");
  post.method = "POST";
  EXPECT_FALSE(policy.AnswerPreflight(post));
  EXPECT_TRUE(Allowing("*").AnswerPreflight(Preflight("https://b.example")));
}

TEST(CorsPolicy, AnswersARequestThatCouldNotBeReadForTheOnlyOrigin) {
  EXPECT_EQ(Allowed(Allowing("*"), HttpRequest()), "*");
  EXPECT_EQ(Allowed(Allowing("https://a.example"), HttpRequest()), "https://a.example");
  EXPECT_EQ(Allowed(Allowing("https://a.example,https://b.example"), HttpRequest()), "");
}

TEST(CorsPolicy, TakesOriginsAsBrowsersSendThem) {
  const auto same = [](std::string_view list, std::string_view origin) {
    return Allowed(Allowing(list), From(origin)) == origin;
  };
  EXPECT_TRUE(same("HTTPS://A.Example", "https://a.example"));
  EXPECT_TRUE(same("https://a.example:443", "https://a.example"));
  EXPECT_TRUE(same("http://a.example:80", "http://a.example"));
  EXPECT_TRUE(same("http://a.example:443", "http://a.example:443"));
  EXPECT_TRUE(same("http://[::1]:3000", "http://[::1]:3000"));
  EXPECT_TRUE(same("http://[2001:DB8::1]", "http://[2001:db8::1]"));
  EXPECT_TRUE(same("capacitor://localhost", "capacitor://localhost"));
}

TEST(CorsPolicy, SaysWhatIsNoOrigin) {
  for (const char* list : {"",
                           ",",
                           "a.example",
                           "https://",
                           "https://a.example/",
                           "https://a.example/x",
                           "://a",
                           "https://a b",
                           "https://a.example:",
                           "https://a.example:x",
                           "https://a.example:65536",
                           "https://user@a.example",
                           "https://a.example?x",
                           "https://*.example",
                           "null",
                           "https://a.example,",
                           "https://a.example,,https://b.example",
                           "*,https://a.example",
                           "https://a.example,*",
                           "http s://a",
                           "https://[::1",
                           "https://[]",
                           "https://\xc3\xa4.de"}) {
    const auto parsed = CorsPolicy::Parse(list);
    EXPECT_TRUE(std::holds_alternative<std::string>(parsed)) << list;
  }
  EXPECT_NE(std::get<std::string>(CorsPolicy::Parse("a,b")).find("'a' is not an origin"),
            std::string::npos);
}

}  // namespace
}  // namespace kdray::server
