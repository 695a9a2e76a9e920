// SPDX-License-Identifier: Apache-2.0
// Against the examples of the Amazon S3 API Reference, "Authenticating Requests: Using the
// Authorization Header", with its credentials.
#include "server/s3_signature.h"

#include <gtest/gtest.h>

#include <span>
#include <string>

#include "core/base/hash.h"

namespace kdray::server {
namespace {

const AwsCredentials kCredentials = {"AKIAIOSFODNN7EXAMPLE",
                                     "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY", ""};

S3Signable Request(const std::string& method, const std::string& path, const std::string& query,
                   std::map<std::string, std::string> more = {}, const std::string& body = "") {
  more["host"] = "examplebucket.s3.amazonaws.com";
  more["x-amz-date"] = "20130524T000000Z";
  more["x-amz-content-sha256"] = core::HashBytes(std::as_bytes(std::span(body))).ToHex();
  return {method, path, query, std::move(more)};
}

std::string SignatureOf(const S3Signable& request) {
  const std::string text = S3Authorization(request, kCredentials, "us-east-1");
  return text.substr(text.rfind('=') + 1);
}

TEST(S3Signature, IsThatOfTheExamplesThatAmazonPublishes) {
  EXPECT_EQ(SignatureOf(Request("GET", "/test.txt", "", {{"range", "bytes=0-9"}})),
            "f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41");
  EXPECT_EQ(SignatureOf(Request("PUT", "/test%24file.text", "",
                                {{"date", "Fri, 24 May 2013 00:00:00 GMT"},
                                 {"x-amz-storage-class", "REDUCED_REDUNDANCY"}},
                                "Welcome to Amazon S3.")),
            "98ad721746da40c64f1a55b78f14c238d841ea1380cd77a1b5971af0ece108bd");
  EXPECT_EQ(SignatureOf(Request("GET", "/", "lifecycle=")),
            "fea454ca298b7da1c68078a5d1bdbfbbe0d65c699e0f91ac7a200a0136783543");
  EXPECT_EQ(SignatureOf(Request("GET", "/", "max-keys=2&prefix=J")),
            "34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7");
}

TEST(S3Signature, NamesItsKeyItsScopeAndTheSignedHeaders) {
  const std::string text = S3Authorization(
      Request("GET", "/test.txt", "", {{"range", "bytes=0-9"}}), kCredentials, "us-east-1");
  EXPECT_EQ(text.substr(0, text.rfind('=')),
            "AWS4-HMAC-SHA256 Credential=AKIAIOSFODNN7EXAMPLE/20130524/us-east-1/s3/aws4_request, "
            "SignedHeaders=host;range;x-amz-content-sha256;x-amz-date, Signature");
}

TEST(S3Signature, TimesAreThoseOfUtc) {
  EXPECT_EQ(AmzDate(0), "19700101T000000Z");
  EXPECT_EQ(AmzDate(1369353600), "20130524T000000Z");
  EXPECT_EQ(AmzDate(4107542399), "21000228T235959Z");
}

}  // namespace
}  // namespace kdray::server
