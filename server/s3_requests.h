// SPDX-License-Identifier: Apache-2.0
// Signed requests to a bucket, by libcurl, which no other file knows. server/s3_store.h says what
// is requested.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "server/aws_settings.h"

namespace kdray::server {

struct S3Request {
  const char* method = "GET";
  std::string key;  ///< of the object, whole; empty: the bucket itself
  /// Not encoded. The map sorts them, as the signature wants: libcurl 7.88 does not.
  std::map<std::string, std::string> query;
  std::span<const std::byte> body;
  bool has_body = false;
  std::vector<std::string> headers;
  std::span<std::byte> out;  ///< where the answer's body goes; else to Answer::text
};

struct S3Answer {
  long status = 0;
  std::string text;
  std::size_t filled = 0;    ///< bytes of `out`
  bool is_too_long = false;  ///< longer than `out`, or than a list can be
  std::string etag;
  std::string length;
  std::string modified;
  std::uint64_t settings = 0;  ///< which settings signed the request
};

/// Safe from many threads at once.
class S3Requests {
 public:
  /// Call once, before the first object. An error if libcurl does not start.
  static core::Status Start();
  /// Seconds since 1970; nullopt for another text than a date of HTTP.
  static std::optional<std::int64_t> ParseDate(const std::string& text);

  S3Requests(std::string bucket, SettingsSource source, AwsSettings settings);
  ~S3Requests();

  /// An answer of any status is success. StoreIsAway; kCorrupt if the answer is longer or shorter
  /// than it should be; kStoreFull for an invalid certificate; kCancelled, kDeadlineExceeded.
  core::Result<S3Answer> Send(const S3Request& request, const core::CancelToken& cancel);

  /// Whether there are other credentials than those which signed the request of `answer`. Reads the
  /// settings again, unless that was done since.
  bool RenewCredentials(const S3Answer& answer);

 private:
  struct State;
  const std::unique_ptr<State> state_;
};

}  // namespace kdray::server
