// SPDX-License-Identifier: Apache-2.0
// Signed requests to a bucket, by libcurl, which no other file knows. server/s3_signature.h signs
// them, server/s3_store.h says what is requested.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "server/aws_settings.h"

namespace kdray::server {

struct S3Request {
  const char* method = "GET";
  std::string key;  ///< of the object, whole; empty: the bucket itself
  /// Not encoded; sorted, as the signature wants.
  std::map<std::string, std::string> query;
  std::span<const std::byte> body;
  bool has_body = false;
  std::map<std::string, std::string> headers;  ///< by names in lower case
  std::span<std::byte> out;                    ///< where the answer's body goes; else to `text`
  /// A request that moves nearly nothing for this long is given up.
  long stall_seconds = 5;
};

struct S3Answer {
  long status = 0;
  std::string text;
  std::size_t filled = 0;    ///< bytes of `out`
  bool is_too_long = false;  ///< longer than `out`, or than a list can be
  std::string etag;
  std::string length;
  std::string modified;
  std::string date;
  std::uint64_t settings = 0;    ///< which settings signed the request
  std::int64_t signed_at_s = 0;  ///< the time in its signature, since 1970
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

  /// Requests are signed with the time of the store's clock, as far as it is known: at first, that
  /// of this machine. If the date of `answer` is more than a minute from the time in its request's
  /// signature, later requests are signed by the clock of `answer`, and the result is true.
  bool FollowClock(const S3Answer& answer);
  /// Milliseconds since 1970, by that clock.
  std::int64_t NowMs() const;

 private:
  struct State;
  const std::unique_ptr<State> state_;
};

}  // namespace kdray::server
