// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/answers.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

namespace kdray::server {
namespace {

bool Has(std::string_view header, std::string_view etag) {
  HttpRequest request;
  request.headers.Add("If-None-Match", header);
  return ClientHas(request, etag);
}

TEST(Answers, KnowWhatTheClientHas) {
  EXPECT_TRUE(Has("\"a\"", "\"a\""));
  EXPECT_TRUE(Has("\"x\", W/\"a\"", "\"a\""));
  EXPECT_TRUE(Has("*", "\"a\""));
  EXPECT_FALSE(Has("", "\"a\""));
  EXPECT_FALSE(Has("a", "\"a\""));
  EXPECT_FALSE(Has("\"b\"", "\"a\""));
  EXPECT_FALSE(ClientHas(HttpRequest(), "\"a\""));
}

TEST(Answers, HaveAValidatorForEverythingTheyDependOn) {
  const std::set<std::string> etags = {
      MakeEtag("render.png", "id", "q"), MakeEtag("render.npy", "id", "q"),
      MakeEtag("render.png", "id2", "q"), MakeEtag("render.png", "id", "q2"),
      MakeEtag("render.png", "idq", "")};
  EXPECT_EQ(etags.size(), 5U);
  EXPECT_EQ(MakeEtag("a", "b", "c"), MakeEtag("a", "b", "c"));
}

TEST(ServerTiming, ListsWhatWasMeasured) {
  ServerTiming timing;
  EXPECT_EQ(timing.Format(), "queue;dur=0.000");
  timing.queue_ms = 1.5;
  timing.trace_ms = 20.25;
  timing.encode_ms = 3;
  EXPECT_EQ(timing.Format(), "queue;dur=1.500, trace;dur=20.250, encode;dur=3.000");
}

}  // namespace
}  // namespace kdray::server
