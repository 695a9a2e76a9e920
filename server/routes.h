// SPDX-License-Identifier: Apache-2.0
// The handlers of paths and methods. Paths are compared byte by byte, not by patterns, which
// hostile paths could make slow.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "api/types.h"
#include "server/handler.h"

namespace kdray::server {

struct Route {
  std::string_view path;  ///< a segment in braces matches any nonempty segment
  Handler get = nullptr;  ///< also for HEAD
  Handler post = nullptr;
  Handler del = nullptr;
  bool open = false;            ///< needs no token, and is answered during shutdown
  bool takes_codings = false;   ///< the body of POST may have a Content-Encoding
  std::string_view label = {};  ///< in metrics, if several paths have one

  /// The route's name in metrics.
  std::string_view Label() const { return label.empty() ? path : label; }
};

/// The paths of the contract, and of the viewer page.
std::span<const Route> Routes();

/// The methods of a route, as in the Allow header.
std::string Allow(const Route& route);

struct RouteMatch {
  const Route* route = nullptr;
  Handler handler = nullptr;        ///< null: the route does not have the method
  std::string_view path_parameter;  ///< the segment in braces, still percent-encoded
};

/// `route` is null for an unknown path. A trailing slash makes a different path.
RouteMatch FindRoute(std::span<const Route> routes, std::string_view method, std::string_view path);

}  // namespace kdray::server
