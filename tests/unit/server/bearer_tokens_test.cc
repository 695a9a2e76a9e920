// SPDX-License-Identifier: Apache-2.0
#include "server/bearer_tokens.h"

#include <gtest/gtest.h>

namespace kdray::server {
namespace {

TEST(BearerTokens, AllowsTheTokensOfTheFileOnly) {
  const auto tokens = BearerTokens::Parse("# services\nalpha\n\nbeta.2=\r\n");
  ASSERT_TRUE(tokens.ok());
  EXPECT_TRUE(tokens->Allows("Bearer alpha"));
  EXPECT_TRUE(tokens->Allows("bearer beta.2="));
  for (const char* value : {"", "Bearer", "Bearer ", "Bearer alph", "Bearer alphaa", "Bearer ALPHA",
                            "alpha", "Basic alpha", "Bearer  alpha", "Bearer alpha ", "Bearer #",
                            "Bearer # services", "Bearer beta.2=\r"}) {
    EXPECT_FALSE(tokens->Allows(value)) << value;
  }
  EXPECT_FALSE(tokens->Allows(std::nullopt));
}

TEST(BearerTokens, RefusesAFileWithoutTokens) {
  EXPECT_FALSE(BearerTokens::Parse("").ok());
  EXPECT_FALSE(BearerTokens::Parse("# nothing\n\n").ok());
}

TEST(BearerTokens, NamesTheLineOfATokenThatNoHeaderCanCarry) {
  const auto tokens = BearerTokens::Parse("good\nnot good\n");
  ASSERT_FALSE(tokens.ok());
  EXPECT_EQ(tokens.error().line, 2U);
  EXPECT_FALSE(BearerTokens::Parse("t\xc3\xb6ken").ok());
}

TEST(TokenGate, AsksForTheTokensThatItWasGivenLast) {
  TokenGate gate(*BearerTokens::Parse("old\n"));
  EXPECT_TRUE(gate.Allows("Bearer old"));
  gate.Replace(*BearerTokens::Parse("new\nother\n"));
  EXPECT_FALSE(gate.Allows("Bearer old"));
  EXPECT_TRUE(gate.Allows("Bearer new"));
  EXPECT_TRUE(gate.Allows("Bearer other"));
}

}  // namespace
}  // namespace kdray::server
