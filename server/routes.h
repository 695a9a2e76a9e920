// Which handler answers which path and method. Paths are compared byte by byte, not by patterns
// that hostile paths could make slow.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "api/types.h"
#include "server/handler.h"

namespace kdray::server {

struct Route {
  std::string_view path;  ///< a segment in braces stands for any one segment that is not empty
  Handler get = nullptr;  ///< answers HEAD, too
  Handler post = nullptr;
  Handler del = nullptr;
  bool open = false;  ///< needs no token, and is answered while the server drains
};

/// The paths of the contract, and of the viewer page.
std::span<const Route> Routes();

/// The methods that a route takes, as the Allow header lists them.
std::string Allow(const Route& route);

struct RouteMatch {
  const Route* route = nullptr;
  Handler handler = nullptr;        ///< null: the route does not take the method
  std::string_view path_parameter;  ///< what stood for the segment in braces, still percent-encoded
};

/// `route` is null for a path of no route. A trailing slash makes another path.
RouteMatch FindRoute(std::span<const Route> routes, std::string_view method, std::string_view path);

}  // namespace kdray::server
