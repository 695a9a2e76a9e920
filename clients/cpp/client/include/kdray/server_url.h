// SPDX-License-Identifier: Apache-2.0
// The address of a server.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace kdray::client {

struct ServerUrl {
  bool tls = false;
  std::string host;  ///< name or address; IPv6 without its brackets
  int port = 80;
  std::string prefix;  ///< path before /v1 if the server is behind a proxy; no slash at the end

  /// The URL, without a slash at the end.
  std::string Text() const;
};

/// `http://host:port/prefix`; the scheme (http) and the port (80 or 443) are optional. Throws
/// UsageError with the cause; user names, queries and fragments are errors.
ServerUrl ParseServerUrl(std::string_view text);

using Parameters = std::vector<std::pair<std::string, std::string>>;

/// `?name=value&…` with all characters percent-encoded except unreserved ones and commas (RFC
/// 3986); empty without parameters.
std::string EncodeQuery(const Parameters& parameters);

}  // namespace kdray::client
