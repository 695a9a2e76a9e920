// SPDX-License-Identifier: Apache-2.0
#include "kdray/server_url.h"

#include <algorithm>
#include <cctype>
#include <charconv>

#include "kdray/error.h"

namespace kdray::client {
namespace {

[[noreturn]] void Reject(std::string_view text, const char* why) {
  throw UsageError("server address '" + Printable(text) + "': " + why +
                   " (an example: http://127.0.0.1:8080)");
}

bool TakePrefix(std::string_view prefix, std::string_view& text) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

/// Like TakePrefix(), in letters of either case (RFC 3986, section 3.1).
bool TakeScheme(std::string_view scheme, std::string_view& text) {
  const std::string_view start = text.substr(0, scheme.size());
  const bool is_same = std::equal(start.begin(), start.end(), scheme.begin(), scheme.end(),
                                  [](unsigned char a, char b) { return std::tolower(a) == b; });
  return is_same && TakePrefix(start, text);
}

}  // namespace

ServerUrl ParseServerUrl(std::string_view text) {
  ServerUrl url;
  std::string_view rest = text;
  if (TakeScheme("https://", rest)) {
    url.tls = true;
    url.port = 443;
  } else if (!TakeScheme("http://", rest) && rest.find("://") != std::string_view::npos) {
    Reject(text, "only http and https are supported");
  }
  if (rest.find_first_of("?#@ \t\r\n") != std::string_view::npos)
    Reject(text, "only host, port and path belong here");

  const std::size_t slash = rest.find('/');
  std::string_view authority = rest.substr(0, slash);
  if (slash != std::string_view::npos) url.prefix = rest.substr(slash);
  while (url.prefix.ends_with('/')) url.prefix.pop_back();

  std::string_view port;
  if (TakePrefix("[", authority)) {
    const std::size_t bracket = authority.find(']');
    if (bracket == std::string_view::npos) Reject(text, "the closing ']' is missing");
    url.host = authority.substr(0, bracket);
    port = authority.substr(bracket + 1);
  } else {
    const std::size_t colon = authority.find(':');
    url.host = authority.substr(0, colon);
    if (colon != std::string_view::npos) port = authority.substr(colon);
  }
  if (url.host.empty()) Reject(text, "the host is missing");
  if (!port.empty()) {
    const char* end = port.data() + port.size();
    const auto [parsed, error] = std::from_chars(port.data() + 1, end, url.port);
    if (port[0] != ':' || error != std::errc() || parsed != end || url.port < 1 || url.port > 65535)
      Reject(text, "the port must be a number from 1 to 65535");
  }
  return url;
}

std::string ServerUrl::Text() const {
  std::string text = tls ? "https://" : "http://";
  text += host.find(':') == std::string::npos ? host : "[" + host + "]";
  if (port != (tls ? 443 : 80)) text += ":" + std::to_string(port);
  return text + prefix;
}

std::string EncodeQuery(const Parameters& parameters) {
  constexpr std::string_view kPlain =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~,";
  constexpr std::string_view kHex = "0123456789ABCDEF";
  std::string query;
  const auto append = [&](std::string_view text) {
    for (const char c : text) {
      if (kPlain.find(c) != std::string_view::npos) {
        query += c;
      } else {
        const auto byte = static_cast<unsigned char>(c);
        query += {'%', kHex[byte >> 4], kHex[byte & 15]};
      }
    }
  };
  for (const auto& [name, value] : parameters) {
    query += query.empty() ? '?' : '&';
    append(name);
    query += '=';
    append(value);
  }
  return query;
}

}  // namespace kdray::client
