// SPDX-License-Identifier: Apache-2.0
#include "server/routes.h"

#include <array>
#include <vector>

#include "server/handlers/cells.h"
#include "server/handlers/documents.h"
#include "server/handlers/points.h"
#include "server/handlers/rays.h"
#include "server/handlers/render.h"
#include "server/handlers/tradeoff.h"
#include "server/handlers/trees.h"
#include "server/handlers/visibility.h"
#include "server/pages/viewer_files.h"

namespace kdray::server {
namespace {

constexpr std::array kContract = {
    Route{.path = "/healthz", .get = GetHealth, .open = true},
    Route{.path = "/readyz", .get = GetReadiness, .open = true},
    Route{.path = "/metrics", .get = GetMetrics},
    Route{.path = "/openapi.json", .get = GetOpenApi},
    Route{.path = "/docs", .get = GetDocs},
    Route{.path = "/problems/{code}", .get = GetProblemPage},
    Route{.path = "/v1", .get = GetCapabilities},
    Route{.path = "/v1/trees", .get = ListTrees, .post = PostTree, .takes_codings = true},
    Route{.path = "/v1/trees/{id}", .get = GetTree, .del = DeleteTree},
    Route{.path = "/v1/trees/{id}/mesh", .get = GetMesh},
    Route{.path = "/v1/trees/{id}/rays/closest", .post = PostRaysClosest},
    Route{.path = "/v1/trees/{id}/rays/any", .post = PostRaysAny},
    Route{.path = "/v1/trees/{id}/points/closest", .post = PostPointsClosest},
    Route{.path = "/v1/trees/{id}/points/signed-distance", .post = PostPointsSignedDistance},
    Route{.path = "/v1/trees/{id}/points/inside", .post = PostPointsInside},
    Route{.path = "/v1/trees/{id}/visibility", .post = PostVisibility},
    Route{.path = "/v1/trees/{id}/rays/count", .post = PostRaysCount},
    Route{.path = "/v1/trees/{id}/rays/all", .post = PostRaysAll},
    Route{.path = "/v1/trees/{id}/render.png", .get = GetRenderPng, .post = PostRenderPng},
    Route{.path = "/v1/trees/{id}/render.npy", .get = GetRenderNpy, .post = PostRenderNpy},
    Route{.path = "/v1/trees/{id}/cells", .get = GetCells},
    Route{.path = "/v1/trees/{id}/tradeoff",
          .get = GetTradeoff,
          .post = PostTradeoff,
          .del = DeleteTradeoff},
};

/// The part up to the next slash; `path` keeps the rest, that slash in front.
std::string_view TakeSegment(std::string_view& path) {
  path.remove_prefix(1);
  const std::string_view segment = path.substr(0, path.find('/'));
  path.remove_prefix(segment.size());
  return segment;
}

/// Whether the pattern describes the path; `parameter` becomes what stood for the segment in
/// braces.
bool Matches(std::string_view pattern, std::string_view path, std::string_view* parameter) {
  while (!pattern.empty() && !path.empty() && path.front() == '/') {
    const std::string_view expected = TakeSegment(pattern);
    const std::string_view segment = TakeSegment(path);
    if (expected.starts_with('{')) {
      if (segment.empty()) return false;
      *parameter = segment;
    } else if (expected != segment) {
      return false;
    }
  }
  return pattern.empty() && path.empty();
}

Handler HandlerFor(const Route& route, std::string_view method) {
  if (method == "GET" || method == "HEAD") return route.get;
  if (method == "POST") return route.post;
  if (method == "DELETE") return route.del;
  return nullptr;
}

}  // namespace

std::span<const Route> Routes() {
  static const std::vector<Route> routes = [] {
    std::vector<Route> all(kContract.begin(), kContract.end());
    for (const ViewerFile& file : ViewerFiles()) {
      all.push_back(Route{.path = file.path, .get = GetViewerFile, .open = true, .label = "/"});
    }
    return all;
  }();
  return routes;
}

std::string Allow(const Route& route) {
  std::string methods;
  const auto add = [&methods](Handler handler, std::string_view names) {
    if (handler == nullptr) return;
    if (!methods.empty()) methods += ", ";
    methods += names;
  };
  add(route.get, "GET, HEAD");
  add(route.post, "POST");
  add(route.del, "DELETE");
  return methods;
}

RouteMatch FindRoute(std::span<const Route> routes, std::string_view method,
                     std::string_view path) {
  for (const Route& route : routes) {
    RouteMatch match;
    if (!Matches(route.path, path, &match.path_parameter)) continue;
    match.route = &route;
    match.handler = HandlerFor(route, method);
    return match;
  }
  return {};
}

}  // namespace kdray::server
