// SPDX-License-Identifier: Apache-2.0
// The common waits of queries, renders and cells before they are computed: for the tree, and for a
// turn.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>

#include "server/handler.h"

namespace kdray::server {

/// The time limit of a request's work.
struct TimeLimit {
  std::int64_t ms = 0;
  std::int64_t default_ms = 0;
  std::string_view parameter;  ///< empty if no parameter changes the limit

  /// Adds the parameter and its value to a problem of time (deadline_exceeded, tree_building);
  /// other problems stay unchanged.
  api::Problem Explain(api::Problem problem) const;
};

/// The objects that must live while the backend works for a request.
struct Computation {
  CancelToken cancel;           ///< the deadline, and the client's departure
  std::shared_ptr<void> watch;  ///< of the client
  std::unique_ptr<const LoadedTree> tree;
  Admission::Turn turn;

  /// Why the work was stopped, once `cancel` says that it is time to stop.
  api::Problem WhyStopped() const;
};

/// Waits until the tree is built and in memory (tree_building if the limit comes first), then for a
/// turn in the lane of its `work` (server/handlers/request_cost.h). The time starts here, after the
/// request is complete, so a slow connection does not use it.
api::Outcome<Computation> BeginComputation(const HandlerContext& context, RoutedRequest& routed,
                                           TreeUse use, const TimeLimit& limit, std::uint64_t work);

}  // namespace kdray::server
