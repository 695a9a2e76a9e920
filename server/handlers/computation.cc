// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/computation.h"

#include <chrono>
#include <string>
#include <utility>

#include "server/mapping.h"

namespace kdray::server {

using api::ErrorCode;
using api::Problem;

Problem TimeLimit::Explain(Problem problem) const {
  if (problem.code != ErrorCode::kDeadlineExceeded && problem.code != ErrorCode::kTreeBuilding) {
    return problem;
  }
  const std::string value = std::to_string(ms);
  problem.limit = static_cast<double>(ms);
  if (parameter.empty()) {
    problem.detail += ": this request may take " + value + " ms";
    return problem;
  }
  problem.parameter = parameter;
  problem.detail += ": " + std::string(parameter) + " is " + value;
  if (ms == default_ms) problem.detail += ", the default";
  return problem;
}

Problem Computation::WhyStopped() const { return ToProblem(cancel.ToError()); }

api::Outcome<Computation> BeginComputation(const HandlerContext& context, RoutedRequest& routed,
                                           TreeUse use, const TimeLimit& limit,
                                           std::uint64_t work) {
  auto cancel = CancelToken::WithDeadline(std::chrono::steady_clock::now() +
                                          std::chrono::milliseconds(limit.ms));
  auto watch = routed.http.peer->CancelWhenGone(cancel);
  // A request that waits for its tree computes nothing, so it needs no turn.
  auto tree = context.backend.Acquire(routed.path_parameter, use, cancel);
  if (!tree) return limit.Explain(std::move(tree).problem());
  auto turn = context.admission.Enter(LaneOf(work), cancel);
  if (!turn) return limit.Explain(std::move(turn).problem());
  routed.timing.queue_ms = turn->waited_ms();
  context.metrics.GotTurn(turn->waited_ms());
  return Computation{std::move(cancel), std::move(watch), *std::move(tree), *std::move(turn)};
}

}  // namespace kdray::server
