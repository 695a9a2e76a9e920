// SPDX-License-Identifier: Apache-2.0
#include "api/tree_id.h"

#include <gtest/gtest.h>

#include <string>

#include "api/names.h"

namespace kdray::api {
namespace {

const std::string kSha256 = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

TEST(TreeIds, AreADigestADashAndABuild) {
  for (const std::string_view build : kBuildNames) {
    const std::string text = kSha256 + "-" + std::string(build);
    const auto id = ParseTreeId(text);
    ASSERT_TRUE(id) << text;
    EXPECT_EQ(id->sha256, kSha256);
    EXPECT_EQ(Name(id->build), build);
    EXPECT_EQ(FormatTreeId(id->sha256, id->build), text);
  }
}

TEST(TreeIds, AreNothingElse) {
  for (const std::string& text : {std::string(),
                                  std::string("-"),
                                  std::string("auto"),
                                  kSha256,
                                  kSha256 + "-",
                                  kSha256 + "auto",
                                  kSha256 + "--auto",
                                  kSha256 + "-auto ",
                                  " " + kSha256 + "-auto",
                                  kSha256 + "-Auto",
                                  kSha256 + "-kd",
                                  kSha256 + "-auto-auto",
                                  kSha256 + "_auto",
                                  kSha256.substr(1) + "-auto",
                                  kSha256 + "0-auto",
                                  "A" + kSha256.substr(1) + "-auto",
                                  "g" + kSha256.substr(1) + "-auto",
                                  "../" + kSha256.substr(3) + "-auto",
                                  kSha256 + std::string("-auto\0", 6),
                                  kSha256 + "-../auto"}) {
    EXPECT_FALSE(ParseTreeId(text)) << text;
  }
}

}  // namespace
}  // namespace kdray::api
