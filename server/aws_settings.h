// SPDX-License-Identifier: Apache-2.0
// What `--store s3://bucket/prefix` needs besides: endpoint, region and credentials, from the usual
// variables and files of AWS. server/s3_store.h uses them.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "core/base/result.h"

namespace kdray::server {

/// s3://bucket or s3://bucket/prefix.
struct StoreUrl {
  std::string bucket;
  std::string prefix;  ///< without a slash at either end; empty for the whole bucket
  /// Equal for equal stores.
  std::string ToString() const { return "s3://" + bucket + (prefix.empty() ? "" : "/" + prefix); }
};
/// An error with a message for a person, which says what is allowed. Buckets are named as S3 says
/// (3 to 63 of a-z, 0-9, '.', '-'); prefixes have printable ASCII without blanks, empty parts, and
/// parts "." and "..".
core::Result<StoreUrl> ParseStoreUrl(std::string_view text);

struct AwsCredentials {
  std::string key_id;
  std::string secret;
  std::string session_token;  ///< empty: none
};

struct AwsSettings {
  AwsCredentials credentials;
  std::string region = "us-east-1";
  std::string endpoint;  ///< as http://127.0.0.1:9000; empty: Amazon's, of the region
  std::string ca_file;   ///< certificates to trust (PEM); empty: those of the system
};

/// A variable of the environment; nullopt if it is not set or empty.
using Environment = std::function<std::optional<std::string>(const std::string& name)>;
Environment ProcessEnvironment();

/// From AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, AWS_REGION or
/// AWS_DEFAULT_REGION, AWS_ENDPOINT_URL_S3 or AWS_ENDPOINT_URL, and AWS_CA_BUNDLE. What these do
/// not have comes from the profile AWS_PROFILE (`default`) in the files AWS_SHARED_CREDENTIALS_FILE
/// (~/.aws/credentials) and AWS_CONFIG_FILE (~/.aws/config). Nothing is asked of the network: no
/// instance metadata, no single sign-on. An error says what is missing, and no secret.
core::Result<AwsSettings> ReadAwsSettings(const Environment& environment);

/// Reads the settings, at the start and when the store says that the credentials have expired.
using SettingsSource = std::function<core::Result<AwsSettings>()>;

}  // namespace kdray::server
