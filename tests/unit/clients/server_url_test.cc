// SPDX-License-Identifier: Apache-2.0
#include "kdray/server_url.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "kdray/error.h"

namespace kdray::client {
namespace {

using ::testing::HasSubstr;

TEST(ServerUrl, UnderstandsTheUsualWaysToNameAServer) {
  const struct {
    const char* text;
    bool tls;
    const char* host;
    int port;
    const char* prefix;
    const char* written;
  } kCases[] = {
      {"http://127.0.0.1:8080", false, "127.0.0.1", 8080, "", "http://127.0.0.1:8080"},
      {"localhost:9000", false, "localhost", 9000, "", "http://localhost:9000"},
      {"example.org", false, "example.org", 80, "", "http://example.org"},
      {"https://example.org", true, "example.org", 443, "", "https://example.org"},
      {"HTTPS://example.org", true, "example.org", 443, "", "https://example.org"},
      {"Http://h:1", false, "h", 1, "", "http://h:1"},
      {"https://example.org:8443/", true, "example.org", 8443, "", "https://example.org:8443"},
      {"http://h/rays/", false, "h", 80, "/rays", "http://h/rays"},
      {"http://h:1/a/b", false, "h", 1, "/a/b", "http://h:1/a/b"},
      {"http://[::1]:8080", false, "::1", 8080, "", "http://[::1]:8080"},
      {"[fe80::abcd]", false, "fe80::abcd", 80, "", "http://[fe80::abcd]"},
      {"http://h:65535", false, "h", 65535, "", "http://h:65535"},
  };
  for (const auto& test : kCases) {
    SCOPED_TRACE(test.text);
    const ServerUrl url = ParseServerUrl(test.text);
    EXPECT_EQ(url.tls, test.tls);
    EXPECT_EQ(url.host, test.host);
    EXPECT_EQ(url.port, test.port);
    EXPECT_EQ(url.prefix, test.prefix);
    EXPECT_EQ(url.Text(), test.written);
  }
}

TEST(ServerUrl, SaysWhatIsWrongWithOthers) {
  const struct {
    const char* text;
    const char* reason;
  } kCases[] = {
      {"", "host is missing"},
      {"http://", "host is missing"},
      {"http://:80", "host is missing"},
      {"ftp://h", "only http and https"},
      {"http://h:0", "port"},
      {"http://h:65536", "port"},
      {"http://h:", "port"},
      {"http://h:80x", "port"},
      {"http://h:-1", "port"},
      {"http://[::1", "']' is missing"},
      {"http://[::1]80", "port"},
      {"http://user@h", "only host, port and path"},
      {"http://h/?q=1", "only host, port and path"},
      {"http://h/#f", "only host, port and path"},
      {"http://h h", "only host, port and path"},
  };
  for (const auto& test : kCases) {
    SCOPED_TRACE(test.text);
    try {
      ParseServerUrl(test.text);
      ADD_FAILURE() << "accepted";
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr(test.reason));
    }
  }
}

TEST(EncodeQuery, KeepsCommasAndEscapesWhatHasAMeaning) {
  EXPECT_EQ(EncodeQuery({}), "");
  EXPECT_EQ(EncodeQuery({{"eye", "1,-2.5,3e+4"}, {"lights", "[{\"a\": 1}]"}}),
            "?eye=1,-2.5,3e%2B4&lights=%5B%7B%22a%22%3A%201%7D%5D");
  EXPECT_EQ(EncodeQuery({{"a", "x&b=c#d%"}}), "?a=x%26b%3Dc%23d%25");
}

}  // namespace
}  // namespace kdray::client
