// The way of every query, render and list of cells to the engine: the tree is built, the client is
// there, it is its turn.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>

#include "server/call.h"

namespace kdray::server {

/// Before a body is read: tree_not_found, or the problem of a build that failed.
api::Check CheckTree(const Services& services, std::string_view id);

/// What must live while the engine works for a request.
struct Work {
  CancelToken cancel;           ///< the deadline, and the client's departure
  std::shared_ptr<void> watch;  ///< for the departure
  Admission::Turn turn;
};

/// Waits until the tree is built (tree_building when the deadline comes first), then for a turn.
/// `deadline_ms` counts from here, where the request is complete: a slow connection does not use it
/// up.
api::Outcome<Work> BeginWork(const Services& services, Call& call, std::int64_t deadline_ms);

}  // namespace kdray::server
