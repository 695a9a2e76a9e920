// Where a server is.
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
  std::string
      prefix;  ///< path before /v1 when the server stands behind a proxy; no slash at the end

  /// As one writes it, without a slash at the end.
  std::string Text() const;
};

/// `http://host:port/prefix`; the scheme may be left out (http), and the port (80 or 443). Throws
/// UsageError that says what is wrong; user names, queries and fragments are not accepted.
ServerUrl ParseServerUrl(std::string_view text);

using Parameters = std::vector<std::pair<std::string, std::string>>;

/// `?name=value&…` with everything but unreserved characters and commas percent-encoded (RFC 3986);
/// empty when there are none.
std::string EncodeQuery(const Parameters& parameters);

}  // namespace kdray::client
