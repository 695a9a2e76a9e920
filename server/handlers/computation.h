// What every query, render and list of cells waits for before it is computed: its tree, and its
// turn.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>

#include "server/handler.h"

namespace kdray::server {

/// The longest that the work for a request may take.
struct TimeLimit {
  std::int64_t ms = 0;
  std::int64_t default_ms = 0;
  std::string_view parameter;  ///< empty when no parameter changes the limit

  /// Completes a problem of time that has passed (deadline_exceeded, tree_building) with the
  /// parameter and its value; others stay as they are.
  api::Problem Explain(api::Problem problem) const;
};

/// What must live while the backend works for a request.
struct Computation {
  CancelToken cancel;           ///< the deadline, and the client's departure
  std::shared_ptr<void> watch;  ///< for the departure
  std::unique_ptr<const LoadedTree> tree;
  Admission::Turn turn;

  /// Why the work was stopped, once `cancel` says that it is time to stop.
  api::Problem WhyStopped() const;
};

/// Waits until the tree is built and in memory (tree_building when the limit comes first), then for
/// a turn. The time counts from here, where the request is complete: a slow connection does not use
/// it up.
api::Outcome<Computation> BeginComputation(const HandlerContext& context, RoutedRequest& routed,
                                           TreeUse use, const TimeLimit& limit);

}  // namespace kdray::server
