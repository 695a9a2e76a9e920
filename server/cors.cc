// SPDX-License-Identifier: Apache-2.0
#include "server/cors.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <utility>

namespace kdray::server {
namespace {

constexpr std::string_view kMethods = "GET, HEAD, POST, DELETE";
/// Those that the contract gives a meaning, except the ones that pages may always send. A browser
/// compares names without regard to case.
constexpr std::string_view kRequestHeaders =
    "Authorization, Content-Encoding, Content-Type, If-None-Match, Traceparent, X-Request-Id";
/// In addition to those whose names begin with Kdray-, and to the ones that pages may always read.
constexpr std::array<std::string_view, 8> kExposed = {"Server-Timing", "Location",        "ETag",
                                                      "X-Request-Id",  "Retry-After",     "Allow",
                                                      "Date",          "WWW-Authenticate"};
/// Seconds for which a browser remembers a preflight; Chromium keeps none longer.
constexpr std::string_view kMaxAge = "7200";

char Lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::string_view Trim(std::string_view text) {
  const auto first = text.find_first_not_of(' ');
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(' ') - first + 1);
}

bool IsSchemeChar(char c) {
  return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '+' || c == '-' || c == '.';
}

/// Host names as browsers write them (IDNA: in ASCII), IPv4 addresses, and IPv6 ones in brackets.
bool IsHost(std::string_view host) {
  if (host.starts_with('[') && host.ends_with(']') && host.size() > 2) {
    host = host.substr(1, host.size() - 2);
    return std::all_of(host.begin(), host.end(), [](char c) {
      return (c >= 'a' && c <= 'f') || (c >= '0' && c <= '9') || c == ':' || c == '.';
    });
  }
  return !host.empty() && std::all_of(host.begin(), host.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_';
  });
}

bool IsPort(std::string_view port) {
  unsigned value = 0;
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), value);
  return error == std::errc() && end == port.data() + port.size() && value <= 65535;
}

/// `scheme://host[:port]` as browsers send it; nullopt for any other text.
std::optional<std::string> ParseOrigin(std::string_view text) {
  std::string origin(text);
  std::transform(origin.begin(), origin.end(), origin.begin(), Lower);
  const auto colon = origin.find("://");
  if (colon == std::string::npos || colon == 0) return std::nullopt;
  const std::string_view scheme = std::string_view(origin).substr(0, colon);
  std::string_view host = std::string_view(origin).substr(colon + 3);
  if (!std::all_of(scheme.begin(), scheme.end(), IsSchemeChar)) return std::nullopt;
  std::string_view port;
  const auto last = host.rfind(':');
  if (last != std::string_view::npos && host.find(']', last) == std::string_view::npos) {
    port = host.substr(last + 1);
    host = host.substr(0, last);
    if (!IsPort(port)) return std::nullopt;
  }
  if (!IsHost(host)) return std::nullopt;
  const bool is_default =
      (scheme == "http" && port == "80") || (scheme == "https" && port == "443");
  std::string canonical = std::string(scheme) + "://" + std::string(host);
  if (!port.empty() && !is_default) canonical += ":" + std::string(port);
  return canonical;
}

/// Appends `name` to Vary.
void Vary(HttpResponse& response, std::string_view name) {
  const auto before = response.headers.Find("Vary");
  response.headers.Set(
      "Vary", before ? std::string(*before) + ", " + std::string(name) : std::string(name));
}

bool IsExposed(std::string_view name) {
  constexpr std::string_view kOwn = "Kdray-";
  if (EqualsIgnoringCase(name.substr(0, kOwn.size()), kOwn)) return true;
  return std::any_of(kExposed.begin(), kExposed.end(), [name](std::string_view exposed) {
    return EqualsIgnoringCase(name, exposed);
  });
}

}  // namespace

std::variant<CorsPolicy, std::string> CorsPolicy::Parse(std::string_view list) {
  CorsPolicy policy;
  for (;;) {
    const auto comma = list.find(',');
    const std::string_view item = Trim(list.substr(0, comma));
    if (item == "*") {
      policy.allows_all_ = true;
    } else if (auto origin = ParseOrigin(item)) {
      policy.origins_.push_back(*std::move(origin));
    } else {
      return "'" + std::string(item) +
             "' is not an origin; write SCHEME://HOST or SCHEME://HOST:PORT without a path, "
             "or * alone";
    }
    if (comma == std::string_view::npos) break;
    list.remove_prefix(comma + 1);
  }
  if (policy.allows_all_ && !policy.origins_.empty()) {
    return std::string("* allows every origin, so it must stand alone");
  }
  return policy;
}

std::optional<std::string> CorsPolicy::AllowedOrigin(const HttpRequest& request) const {
  if (allows_all_) return "*";
  const auto origin = request.headers.Find("Origin");
  if (!origin) {
    const bool is_unread = request.headers.fields().empty();
    return is_unread && origins_.size() == 1 ? std::optional(origins_.front()) : std::nullopt;
  }
  if (request.headers.Count("Origin") != 1) return std::nullopt;
  if (std::find(origins_.begin(), origins_.end(), *origin) == origins_.end()) return std::nullopt;
  return std::string(*origin);
}

std::optional<HttpResponse> CorsPolicy::AnswerPreflight(const HttpRequest& request) const {
  if (!is_enabled() || request.method != "OPTIONS" || !request.headers.Find("Origin") ||
      !request.headers.Find("Access-Control-Request-Method") || !AllowedOrigin(request)) {
    return std::nullopt;
  }
  HttpResponse response;
  response.status = 204;
  response.headers.Add("Access-Control-Allow-Methods", kMethods);
  response.headers.Add("Access-Control-Allow-Headers", kRequestHeaders);
  response.headers.Add("Access-Control-Max-Age", kMaxAge);
  response.headers.Add("Cache-Control", "no-store");
  return response;
}

void CorsPolicy::AddHeaders(const HttpRequest& request, HttpResponse& response) const {
  if (!is_enabled()) return;
  // A cache must not give one origin the answer to another, nor to one without.
  if (!allows_all_) Vary(response, "Origin");
  const auto origin = AllowedOrigin(request);
  if (!origin) return;
  std::string exposed;
  for (const auto& [name, value] : response.headers.fields()) {
    if (!IsExposed(name)) continue;
    if (!exposed.empty()) exposed += ", ";
    exposed += name;
  }
  response.headers.Add("Access-Control-Allow-Origin", *origin);
  // For what a proxy in front asks for, such as cookies; tokens need no permission.
  if (!allows_all_) response.headers.Add("Access-Control-Allow-Credentials", "true");
  if (!exposed.empty()) response.headers.Add("Access-Control-Expose-Headers", exposed);
}

}  // namespace kdray::server
