// SPDX-License-Identifier: Apache-2.0
// Cross-origin requests of pages in browsers (CORS): which origins may read answers, and the
// answers to preflights. Source: WHATWG, Fetch Standard, 3.2 (CORS protocol).
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "server/http/message.h"

namespace kdray::server {

/// The allowed origins; by default none, and then no answer has a header of it. Immutable.
class CorsPolicy {
 public:
  CorsPolicy() = default;

  /// `list`: `*`, or origins separated by commas, as `https://example.org:8443`. Upper case is
  /// taken as lower case, and a scheme's default port is left out, as browsers do. Or what is wrong
  /// with it, for people.
  static std::variant<CorsPolicy, std::string> Parse(std::string_view list);

  bool is_enabled() const { return allows_all_ || !origins_.empty(); }

  /// The answer to a preflight (OPTIONS with Origin and Access-Control-Request-Method) of an
  /// allowed origin, without the headers of AddHeaders(). nullopt for another request.
  std::optional<HttpResponse> AnswerPreflight(const HttpRequest& request) const;

  /// Adds to an answer of `request` what lets the page read it: the origin, the names of our
  /// headers, and Vary. If the request could not be read, its origin is unknown; then the answer is
  /// for `*`, or for the only origin in the list.
  void AddHeaders(const HttpRequest& request, HttpResponse& response) const;

 private:
  /// The value of Access-Control-Allow-Origin; nullopt if the origin is not allowed.
  std::optional<std::string> AllowedOrigin(const HttpRequest& request) const;

  bool allows_all_ = false;
  std::vector<std::string> origins_;  ///< as browsers send them
};

}  // namespace kdray::server
