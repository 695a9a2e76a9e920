// SPDX-License-Identifier: Apache-2.0
#include "server/log_query.h"

#include <gtest/gtest.h>

#include <string>

namespace kdray::server {
namespace {

TEST(LoggedQuery, ShowsTheParametersOfTheContractAsTheyWereSent) {
  for (const char* query :
       {"", "width=320", "mode=depth&eye=1%2C2,3&max_hits=7", "t_min=auto&deadline_ms=x y",
        "mesh=0123&build=bvh&wait_ms=0&limit=&after=a.b",
        "from_count=2&bits=true&depth=3&limit=8"}) {
    EXPECT_EQ(LoggedQuery(query), query);
  }
}

TEST(LoggedQuery, HidesWhateverElseIsSent) {
  EXPECT_EQ(LoggedQuery("token=secret"), "***");
  EXPECT_EQ(LoggedQuery("width=1&access_token=secret&height=2"), "width=1&***&height=2");
  EXPECT_EQ(LoggedQuery("c2VjcmV0=="), "***");
  EXPECT_EQ(LoggedQuery("secret&Width=1&%77idth=1&=secret"), "***&***&***&***");
  EXPECT_EQ(LoggedQuery("width"), "***");
  EXPECT_EQ(LoggedQuery("&&width=1&"), "width=1");
}

TEST(LoggedQuery, CutsWhatIsLong) {
  const std::string shown = LoggedQuery("lights=" + std::string(5000, 'x') + "&width=1");
  EXPECT_EQ(shown.size(), 515U);
  EXPECT_TRUE(shown.ends_with("x..."));
  EXPECT_EQ(LoggedQuery("lights=" + std::string(505, 'x')).size(), 512U);
  std::string many;
  for (int i = 0; i < 4000; ++i) many += "a=b&";
  EXPECT_EQ(LoggedQuery(many).size(), 515U);
}

}  // namespace
}  // namespace kdray::server
