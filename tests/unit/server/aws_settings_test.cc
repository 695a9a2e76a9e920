// SPDX-License-Identifier: Apache-2.0
#include "server/aws_settings.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <tuple>

#include "tests/support/temporary_folder.h"

namespace kdray::server {
namespace {

using test::TemporaryFolder;
using test::WriteText;

class AwsSettingsTest : public testing::Test {
 protected:
  core::Result<AwsSettings> Read() {
    return ReadAwsSettings([this](const std::string& name) -> std::optional<std::string> {
      const auto found = variables_.find(name);
      if (found == variables_.end()) return std::nullopt;
      return found->second;
    });
  }

  TemporaryFolder folder_;
  std::map<std::string, std::string> variables_ = {{"HOME", folder_.path()}};
};

TEST_F(AwsSettingsTest, ComeFromTheEnvironment) {
  variables_.insert({{"AWS_ACCESS_KEY_ID", "id"},
                     {"AWS_SECRET_ACCESS_KEY", "secret"},
                     {"AWS_SESSION_TOKEN", "token"},
                     {"AWS_DEFAULT_REGION", "eu-west-1"},
                     {"AWS_ENDPOINT_URL", "http://127.0.0.1:9000/"}});
  auto settings = Read();
  ASSERT_TRUE(settings.ok()) << settings.error().message;
  EXPECT_EQ(settings->credentials.key_id, "id");
  EXPECT_EQ(settings->credentials.secret, "secret");
  EXPECT_EQ(settings->credentials.session_token, "token");
  EXPECT_EQ(settings->region, "eu-west-1");
  EXPECT_EQ(settings->endpoint, "http://127.0.0.1:9000");
  variables_["AWS_REGION"] = "eu-west-2";
  variables_["AWS_ENDPOINT_URL_S3"] = "https://s3.example.org";
  variables_["AWS_CA_BUNDLE"] = "ca.pem";
  settings = Read();
  ASSERT_TRUE(settings.ok());
  EXPECT_EQ(settings->region, "eu-west-2");
  EXPECT_EQ(settings->endpoint, "https://s3.example.org");
  EXPECT_EQ(settings->ca_file, "ca.pem");
}

TEST_F(AwsSettingsTest, ComeFromTheProfileInTheFiles) {
  std::filesystem::create_directory(folder_.path() / ".aws");
  WriteText(folder_ / ".aws/credentials",
            "# comment\n[default]\naws_access_key_id=a\naws_secret_access_key = b=c \n"
            "[ work ]\naws_access_key_id = d\naws_secret_access_key = e\naws_session_token=f\n");
  WriteText(folder_ / ".aws/config",
            "[default]\nregion = eu-north-1\n[profile work]\ns3 =\n  region = nested\n"
            "endpoint_url = http://store:80\nca_bundle = /etc/ca.pem\n");
  auto settings = Read();
  ASSERT_TRUE(settings.ok());
  EXPECT_EQ(settings->credentials.key_id, "a");
  EXPECT_EQ(settings->credentials.secret, "b=c");
  EXPECT_EQ(settings->region, "eu-north-1");
  variables_["AWS_PROFILE"] = "work";
  settings = Read();
  ASSERT_TRUE(settings.ok());
  EXPECT_EQ(settings->credentials.key_id, "d");
  EXPECT_EQ(settings->credentials.session_token, "f");
  EXPECT_EQ(settings->region, "us-east-1") << "the default";
  EXPECT_EQ(settings->endpoint, "http://store:80");
  EXPECT_EQ(settings->ca_file, "/etc/ca.pem");
  variables_["AWS_ACCESS_KEY_ID"] = "g";
  EXPECT_FALSE(Read().ok()) << "half of a credential is not completed from elsewhere";
}

TEST_F(AwsSettingsTest, SayWhatIsMissingOrWrong) {
  EXPECT_NE(Read().error().message.find("AWS_ACCESS_KEY_ID"), std::string::npos);
  variables_.insert({{"AWS_ACCESS_KEY_ID", "id"}, {"AWS_SECRET_ACCESS_KEY", "secret"}});
  ASSERT_TRUE(Read().ok());
  for (const char* endpoint : {"store", "ftp://store", "http://", "http://store/path",
                               "http://user@store", "http://sto re"}) {
    variables_["AWS_ENDPOINT_URL"] = endpoint;
    EXPECT_FALSE(Read().ok()) << endpoint;
  }
  variables_.erase("AWS_ENDPOINT_URL");
  variables_["AWS_REGION"] = "EU:1";
  EXPECT_FALSE(Read().ok());
}

TEST(StoreUrl, IsABucketWithOrWithoutAPrefix) {
  for (const auto& [text, bucket, prefix] :
       {std::tuple("s3://meshes", "meshes", ""), std::tuple("s3://meshes/", "meshes", ""),
        std::tuple("s3://my.meshes-1/a/b", "my.meshes-1", "a/b"),
        std::tuple("s3://meshes/A_b+c/", "meshes", "A_b+c")}) {
    const auto url = ParseStoreUrl(text);
    ASSERT_TRUE(url.ok()) << text;
    EXPECT_EQ(url->bucket, bucket);
    EXPECT_EQ(url->prefix, prefix);
  }
  EXPECT_EQ(ParseStoreUrl("s3://meshes/a/")->ToString(), "s3://meshes/a");
  for (const char* text : {"", "meshes", "s3:/meshes", "s3://", "s3://ab", "s3://Meshes",
                           "s3://meshes-", "s3://meshes//a", "s3://meshes/a//b", "s3://meshes/./a",
                           "s3://meshes/..", "s3://meshes/a b", "http://meshes/a"}) {
    const auto url = ParseStoreUrl(text);
    ASSERT_FALSE(url.ok()) << text;
    EXPECT_NE(url.error().message.find("s3://BUCKET"), std::string::npos);
  }
}

}  // namespace
}  // namespace kdray::server
