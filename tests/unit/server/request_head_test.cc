// SPDX-License-Identifier: Apache-2.0
#include "server/http/request_head.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

namespace kdray::server {
namespace {

using api::ErrorCode;

RequestHead Accepted(const std::string& text) {
  auto parsed = ParseRequestHead(text, {});
  if (const auto* refused = std::get_if<RefusedHead>(&parsed)) {
    ADD_FAILURE() << text << "\nrefused: " << refused->problem.detail;
    return {};
  }
  return std::get<RequestHead>(std::move(parsed));
}

std::optional<ErrorCode> Refusal(const std::string& text) {
  const auto parsed = ParseRequestHead(text, {});
  const auto* refused = std::get_if<RefusedHead>(&parsed);
  return refused == nullptr ? std::nullopt : std::optional(refused->problem.code);
}

std::string WithLines(const std::string& lines, const std::string& method = "POST") {
  return method + " /v1/trees HTTP/1.1\r\nHost: h\r\n" + lines + "\r\n";
}

TEST(RequestHead, KeepsTheTargetAsItCame) {
  const RequestHead head = Accepted("GET /a%20b/../c?x=%2F&y=1?2 HTTP/1.1\r\nHost: h\r\n\r\n");
  EXPECT_EQ(head.method, "GET");
  EXPECT_EQ(head.path, "/a%20b/../c");
  EXPECT_EQ(head.query_string, "x=%2F&y=1?2");
}

TEST(RequestHead, KeepsHeaderValuesAsTheyCameButForTheBlanksAround) {
  const RequestHead head =
      Accepted(WithLines("Authorization:\t Bearer a%0d%0ab  \r\nx-empty:\r\n"));
  EXPECT_EQ(head.headers.Find("authorization"), "Bearer a%0d%0ab");
  EXPECT_EQ(head.headers.Find("X-EMPTY"), "");
}

TEST(RequestHead, CutsAnAbsoluteTargetDownToItsPath) {
  EXPECT_EQ(Accepted("GET http://h:80/v1?a=b HTTP/1.1\r\nHost: h\r\n\r\n").path, "/v1");
  EXPECT_EQ(Accepted("GET http://h:80/v1?a=b HTTP/1.1\r\nHost: h\r\n\r\n").query_string, "a=b");
  EXPECT_EQ(Accepted("GET http://h HTTP/1.1\r\nHost: h\r\n\r\n").path, "/");
  EXPECT_EQ(Accepted("GET HTTP://h?q HTTP/1.1\r\nHost: h\r\n\r\n").query_string, "q");
}

TEST(RequestHead, TakesAnAsteriskFromOptionsAlone) {
  EXPECT_EQ(Accepted("OPTIONS * HTTP/1.1\r\nHost: h\r\n\r\n").path, "*");
  for (const char* method : {"GET", "HEAD", "POST", "options"}) {
    EXPECT_EQ(Refusal(std::string(method) + " * HTTP/1.1\r\nHost: h\r\n\r\n"),
              ErrorCode::kMalformedRequest)
        << method;
  }
}

TEST(RequestHead, ReadsTheLengthOfTheBody) {
  EXPECT_EQ(Accepted(WithLines("")).content_length, 0U);
  EXPECT_EQ(Accepted(WithLines("Content-Length: 0\r\n", "GET")).content_length, 0U);
  EXPECT_EQ(Accepted(WithLines("Content-Length: 0042\r\n")).content_length, 42U);
  EXPECT_EQ(Accepted(WithLines("Content-Length: 18446744073709551615\r\n")).content_length,
            std::numeric_limits<std::uint64_t>::max());
  EXPECT_EQ(Accepted(WithLines("Content-Length: 99999999999999999999999999\r\n")).content_length,
            std::numeric_limits<std::uint64_t>::max());
}

TEST(RequestHead, RefusesLengthsThatTwoReadersCouldUnderstandDifferently) {
  for (const char* value :
       {"-1", "+1", "0x10", "1e3", "abc", "", "1 2", "1,1", "1.0", "\xd9\xa1"}) {
    EXPECT_EQ(Refusal(WithLines("Content-Length: " + std::string(value) + "\r\n")),
              ErrorCode::kMalformedRequest)
        << value;
  }
  EXPECT_EQ(Refusal(WithLines("Content-Length: 1\r\nContent-Length: 1\r\n")),
            ErrorCode::kMalformedRequest);
  EXPECT_EQ(Refusal(WithLines("Content-Length: 1\r\nTransfer-Encoding: chunked\r\n")),
            ErrorCode::kMalformedRequest);
  EXPECT_EQ(Refusal(WithLines("Content-Length : 1\r\n")), ErrorCode::kMalformedRequest);
}

TEST(RequestHead, TakesExactlyChunkedAsTransferEncoding) {
  for (const char* value : {"chunked", "Chunked", " \tCHUNKED\t "}) {
    const RequestHead head =
        Accepted(WithLines("Transfer-Encoding:" + std::string(value) + "\r\n"));
    EXPECT_TRUE(head.chunked) << value;
    EXPECT_EQ(head.content_length, 0U);
  }
  EXPECT_FALSE(Accepted(WithLines("Content-Length: 5\r\n")).chunked);
  for (const char* value :
       {"identity", "gzip, chunked", "chunked, gzip", "chunked, chunked", "chunked,", ",chunked",
        "xchunked", "chunkedx", "chunked;q=1", "\"chunked\"", "", "chun ked"}) {
    EXPECT_EQ(Refusal(WithLines("Transfer-Encoding: " + std::string(value) + "\r\n")),
              ErrorCode::kLengthRequired)
        << value;
  }
  EXPECT_EQ(Refusal(WithLines("Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n")),
            ErrorCode::kLengthRequired);
  EXPECT_EQ(Refusal(WithLines("Transfer-Encoding: gzip\r\nTransfer-Encoding: chunked\r\n")),
            ErrorCode::kLengthRequired);
}

TEST(RequestHead, RefusesChunksWhereTheLengthIsUncertain) {
  for (const char* lines :
       {"Transfer-Encoding: chunked\r\nContent-Length: 0\r\n",
        "Content-Length: 5\r\nTransfer-Encoding: chunked\r\n",
        "Content-Length: 5\r\nTransfer-Encoding: xchunked\r\n", "Transfer-Encoding : chunked\r\n",
        "Transfer-Encoding:\r\n chunked\r\n", "Transfer-Encoding: chunked\x0b\r\n",
        "Transfer-Encoding\t: chunked\r\n"}) {
    EXPECT_EQ(Refusal(WithLines(lines)), ErrorCode::kMalformedRequest) << lines;
  }
  EXPECT_EQ(Refusal("POST / HTTP/1.0\r\nTransfer-Encoding: chunked\r\n\r\n"),
            ErrorCode::kMalformedRequest);
}

TEST(RequestHead, FindsTheOriginOfARefusedRequest) {
  for (const std::string& head :
       {"GET /" + std::string(9000, 'a') + " HTTP/1.1\r\nHost: h\r\norigin: https://a\r\n\r\n",
        std::string("nonsense\r\nOrigin:https://a\r\n\r\n"),
        std::string("GET / HTTP/1.1\nX: Origin: no\nOrigin: https://a\r\n\n")}) {
    const auto parsed = ParseRequestHead(head, {});
    const auto* refused = std::get_if<RefusedHead>(&parsed);
    ASSERT_NE(refused, nullptr);
    EXPECT_EQ(refused->known.headers.Find("Origin"), "https://a") << head;
  }
  EXPECT_TRUE(FindOrigin("GET / HTTP/1.1\r\nOrigin: cut").fields().empty());
  EXPECT_TRUE(FindOrigin("Origin: in the first line\r\n").fields().empty());
}

TEST(RequestHead, RefusesABodyWhereNoneBelongs) {
  for (const char* method : {"GET", "HEAD", "DELETE", "OPTIONS", "TRACE", "BREW"}) {
    EXPECT_EQ(Refusal(WithLines("Content-Length: 1\r\n", method)), ErrorCode::kMalformedRequest)
        << method;
    EXPECT_EQ(Refusal(WithLines("Transfer-Encoding: chunked\r\n", method)),
              ErrorCode::kMalformedRequest)
        << method;
  }
}

TEST(RequestHead, RefusesBareLineFeedsFoldedLinesAndControlCharacters) {
  const std::vector<std::string> heads = {
      "GET / HTTP/1.1\nHost: h\n\n",
      "GET / HTTP/1.1\r\nHost: h\n\r\n",
      "GET / HTTP/1.1\r\nHost: h\r\n\n",
      WithLines("X: a\r\n folded\r\n"),
      WithLines("X: a\r\n\tfolded\r\n"),
      WithLines("X: a\rb\r\n"),
      WithLines(std::string("X: a\0b\r\n", 8)),
      WithLines("X: a\x7f\r\n"),
      WithLines("no colon\r\n"),
      WithLines(": no name\r\n"),
      WithLines("X Y: blank in the name\r\n"),
      WithLines("\xc3\xa4: not a token\r\n"),
  };
  for (const std::string& head : heads) {
    EXPECT_EQ(Refusal(head), ErrorCode::kMalformedRequest) << head;
  }
}

TEST(RequestHead, RefusesRequestLinesThatAreNone) {
  for (const char* line :
       {"", "GET", "GET /", "GET / HTTP/1.1 ", "GET  / HTTP/1.1", " GET / HTTP/1.1",
        "GET /a b HTTP/1.1", "GET / HTTP/2.0", "GET / HTTP/1.2", "GET / http/1.1", "GET x HTTP/1.1",
        "GET /#f HTTP/1.1", "GET /\x80 HTTP/1.1", "G\x01T / HTTP/1.1", "GET /\t HTTP/1.1",
        "GET ftp://h/ HTTP/1.1"}) {
    EXPECT_EQ(Refusal(std::string(line) + "\r\nHost: h\r\n\r\n"), ErrorCode::kMalformedRequest)
        << line;
  }
}

TEST(RequestHead, WantsOneHost) {
  EXPECT_EQ(Refusal("GET / HTTP/1.1\r\n\r\n"), ErrorCode::kMalformedRequest);
  EXPECT_EQ(Refusal("GET / HTTP/1.1\r\nHost: a\r\nHost: a\r\n\r\n"), ErrorCode::kMalformedRequest);
  EXPECT_EQ(Refusal("GET / HTTP/1.0\r\n\r\n"), std::nullopt);
}

TEST(RequestHead, TakesAsManyFieldsAsItsLimitAndNoMore) {
  std::string lines;
  for (int i = 0; i < 63; ++i) lines += "X-" + std::to_string(i) + ": v\r\n";
  EXPECT_EQ(Refusal(WithLines(lines)), std::nullopt);
  EXPECT_EQ(Refusal(WithLines(lines + "X: v\r\n")), ErrorCode::kHeadersTooLarge);
}

TEST(RequestHead, TakesATargetAsLongAsItsLimitAndNoLonger) {
  const std::string longest = "/" + std::string(8 * 1024 - 1, 'a');
  EXPECT_EQ(Refusal("GET " + longest + " HTTP/1.1\r\nHost: h\r\n\r\n"), std::nullopt);
  EXPECT_EQ(Refusal("GET " + longest + "a HTTP/1.1\r\nHost: h\r\n\r\n"), ErrorCode::kUriTooLong);
}

TEST(RequestHead, KnowsWhetherTheConnectionIsKept) {
  EXPECT_TRUE(Accepted("GET / HTTP/1.1\r\nHost: h\r\n\r\n").keep_alive);
  EXPECT_FALSE(Accepted("GET / HTTP/1.1\r\nHost: h\r\nConnection: x, CLOSE\r\n\r\n").keep_alive);
  EXPECT_FALSE(Accepted("GET / HTTP/1.0\r\n\r\n").keep_alive);
  EXPECT_TRUE(Accepted("GET / HTTP/1.0\r\nConnection: Keep-Alive\r\n\r\n").keep_alive);
}

TEST(RequestHead, KnowsWhetherTheClientWaitsToBeToldToGoOn) {
  EXPECT_TRUE(
      Accepted(WithLines("Expect: 100-Continue\r\nContent-Length: 1\r\n")).expects_continue);
  EXPECT_FALSE(Accepted(WithLines("Expect: more\r\nContent-Length: 1\r\n")).expects_continue);
  EXPECT_FALSE(Accepted("POST / HTTP/1.0\r\nExpect: 100-continue\r\nContent-Length: 1\r\n\r\n")
                   .expects_continue);
}

TEST(RequestHead, TellsWhatItKnowsOfARequestThatItRefuses) {
  const auto parsed = ParseRequestHead(WithLines("Content-Length: -1\r\n"), {});
  const RequestHead& known = std::get<RefusedHead>(parsed).known;
  EXPECT_EQ(known.method, "POST");
  EXPECT_EQ(known.path, "/v1/trees");
}

TEST(RequestHead, OverlooksOneEmptyLineInFront) {
  EXPECT_EQ(Accepted("\r\nGET /v1 HTTP/1.1\r\nHost: h\r\n\r\n").path, "/v1");
}

TEST(FindHeadEnd, FindsTheEmptyLineWhereverThePiecesAreCut) {
  for (const std::string head :
       {"GET / HTTP/1.1\r\nHost: h\r\n\r\n", "\r\nGET / HTTP/1.1\r\nHost: h\r\n\r\n",
        "GET / HTTP/1.1\nHost: h\n\n"}) {
    const std::string text = head + "body\r\n\r\n";
    for (std::size_t cut = 0; cut < head.size(); ++cut) {
      ASSERT_EQ(FindHeadEnd(std::string_view(text).substr(0, cut), 0), 0U) << head << cut;
      ASSERT_EQ(FindHeadEnd(text, cut), head.size()) << head << cut;
    }
  }
}

}  // namespace
}  // namespace kdray::server
