// SPDX-License-Identifier: Apache-2.0
#include "api/batch_type.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace kdray::api {
namespace {

using testing::HasSubstr;
using enum BatchType;

constexpr std::string_view kNpyBody = "\x93NUMPY\x01";
constexpr std::string_view kJsonBody = " \n{\"rays\":[]}";

TEST(BatchTypes, AreToldByTheFirstBytesWhateverIsNamed) {
  for (const std::optional<std::string_view> named :
       {std::optional<std::string_view>(), std::optional<std::string_view>(""),
        std::optional<std::string_view>("application/octet-stream"),
        std::optional<std::string_view>("application/x-www-form-urlencoded"),
        std::optional<std::string_view>("application/json"),
        std::optional<std::string_view>("application/json; charset=utf-8"),
        std::optional<std::string_view>(" Application/X-NPY "),
        std::optional<std::string_view>("application/x-npy;version=1")}) {
    EXPECT_EQ(*DetectBatchType(kNpyBody, named), kNpy) << named.value_or("(none)");
    EXPECT_EQ(*DetectBatchType("\x93", named), kNpy) << "cut short";
    EXPECT_EQ(*DetectBatchType(kJsonBody, named), kJson) << named.value_or("(none)");
  }
}

TEST(BatchTypes, FollowTheNameWhereTheBytesAreNeither) {
  for (const std::string_view body : {"", "hello", "[1,2,3]"}) {
    EXPECT_EQ(*DetectBatchType(body, "application/x-npy"), kNpy) << body;
    EXPECT_EQ(*DetectBatchType(body, "application/json"), kJson) << body;
    EXPECT_EQ(*DetectBatchType(body, std::nullopt), kJson) << body;
  }
}

TEST(BatchTypes, LeaveArchivesToTheReaderOfArrays) {
  for (const std::string_view body : {"PK\x03\x04rest", "\x1f\x8b\x08rest"}) {
    EXPECT_EQ(*DetectBatchType(body, std::nullopt), kNpy);
    EXPECT_EQ(*DetectBatchType(body, "application/json"), kNpy);
  }
}

TEST(BatchTypes, RefuseOtherNames) {
  for (const std::string_view named :
       {"text/plain", "text/plain;charset=UTF-8", "application/xml", "multipart/form-data",
        "application/jsonx", "application", "application/*", "json", "image/png"}) {
    for (const std::string_view body : {kNpyBody, kJsonBody}) {
      const auto type = DetectBatchType(body, named);
      ASSERT_FALSE(type) << named;
      EXPECT_EQ(type.problem().code, ErrorCode::kUnsupportedMediaType);
      EXPECT_THAT(type.problem().detail,
                  HasSubstr("send application/json or application/x-npy, or name nothing"));
      EXPECT_EQ(type.problem().parameter, "Content-Type");
    }
  }
}

TEST(AnswerTypes, AreThoseOfTheRequestOrWhatAcceptNames) {
  struct Case {
    std::optional<std::string_view> accept;
    std::optional<BatchType> wanted;  ///< nullopt: the request's
  };
  const Case cases[] = {
      {std::nullopt, std::nullopt},
      {"", std::nullopt},
      {" , ", std::nullopt},
      {"*/*", std::nullopt},
      {"application/*", std::nullopt},
      {"text/html, */*;q=0.8", std::nullopt},
      {"application/json", kJson},
      {"application/x-npy", kNpy},
      {"Application/X-Npy", kNpy},
      {"application/json;charset=utf-8", kJson},
      {"text/html,application/json", kJson},
      {"application/json, text/plain, */*", kJson},
      {"*/*, application/x-npy", kNpy},
      {"application/json, application/x-npy", std::nullopt},
      {"application/json;q=0.5, application/x-npy", kNpy},
      {"application/json;q=0.5, application/x-npy;q=0.4", kJson},
      {"application/json; q=0.5, */*;q=0.9", kNpy},
      {"application/x-npy;q=0, */*", kJson},
      {"application/*;q=0.2, */*;q=1", std::nullopt},
      {"application/json;q=0, application/x-npy;q=0.001", kNpy},
      {"application/json;q=nonsense", kJson},
      {"application/json;q=7", kJson},
      {"image/png, application/x-npy;Q=1.0", kNpy},
  };
  for (const Case& c : cases) {
    for (const BatchType request : {kJson, kNpy}) {
      const auto type = ChooseAnswerType(c.accept, request);
      ASSERT_TRUE(type) << c.accept.value_or("(none)");
      EXPECT_EQ(*type, c.wanted.value_or(request)) << c.accept.value_or("(none)");
    }
  }
}

TEST(AnswerTypes, CannotBeWhatAcceptExcludes) {
  for (const std::string_view accept :
       {"text/html", "image/*", "application/xml", "*/*;q=0", "application/*;q=0",
        "application/json;q=0, application/x-npy;q=0.0, text/html"}) {
    const auto type = ChooseAnswerType(accept, kJson);
    ASSERT_FALSE(type) << accept;
    EXPECT_EQ(type.problem().code, ErrorCode::kNotAcceptable);
    EXPECT_THAT(type.problem().detail, HasSubstr("application/json or application/x-npy"));
  }
}

}  // namespace
}  // namespace kdray::api
