// SPDX-License-Identifier: Apache-2.0
// AWS Signature Version 4 of a request to S3. server/s3_requests.h sends what is signed here. The
// time is the caller's: libcurl could sign too, but by its own clock only, because version 7.88
// sends a time that is given to it twice.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "server/aws_settings.h"

namespace kdray::server {

struct S3Signable {
  std::string method;
  std::string path;   ///< encoded as it is sent; begins with a slash
  std::string query;  ///< as it is sent: encoded, `name=value`, ascending; may be empty
  /// All headers that are signed, by their names in lower case: `host`, `x-amz-content-sha256` (of
  /// the body, hexadecimal), `x-amz-date` (AmzDate) and others. Values have no blank at an end, and
  /// no two blanks together.
  std::map<std::string, std::string> headers;
};

/// As 20130524T000000Z; seconds since 1970.
std::string AmzDate(std::int64_t seconds);

/// The value of the header Authorization. Source: Amazon S3 API Reference, "Authenticating
/// Requests: Using the Authorization Header".
std::string S3Authorization(const S3Signable& request, const AwsCredentials& credentials,
                            const std::string& region);

}  // namespace kdray::server
