#include "server/handlers/work.h"

#include <chrono>
#include <string>
#include <utility>

#include "server/mapping.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;

}  // namespace

api::Check CheckTree(const Services& services, std::string_view id) {
  auto tree = services.engine.Describe(id);
  if (!tree) return std::move(tree).problem();
  return std::nullopt;
}

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

Problem Work::WhyStopped() const { return ToProblem(cancel.ToError()); }

api::Outcome<Work> BeginWork(const Services& services, Call& call, const TimeLimit& limit) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(limit.ms);
  auto cancel = CancelToken::WithDeadline(deadline);
  auto watch = call.request.peer->CancelWhenGone(cancel);

  // A query that waits for a build computes nothing: it takes no turn from others.
  const auto tree = services.engine.WaitUntilBuilt(call.name, deadline, cancel);
  if (!tree) return tree.problem();
  if (!tree->ready) {
    return limit.Explain({.code = ErrorCode::kTreeBuilding,
                          .detail = "the tree was not built in time, " +
                                    std::to_string(static_cast<int>(tree->progress * 100)) +
                                    " percent of the work is done"});
  }
  auto turn = services.admission.Enter(cancel);
  if (!turn) return limit.Explain(std::move(turn).problem());
  call.timing.queue_ms = turn->waited_ms();
  return Work{std::move(cancel), std::move(watch), *std::move(turn)};
}

}  // namespace kdray::server
