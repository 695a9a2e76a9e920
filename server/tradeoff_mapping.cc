// SPDX-License-Identifier: Apache-2.0
// The measured trade-off: from core's three lists to the contract's rows.
#include <algorithm>

#include "server/http/time_text.h"
#include "server/mapping.h"

namespace kdray::server {
namespace {

api::ErrorRate ToRate(const core::ErrorRate& rate) { return {rate.count, rate.rays}; }

api::RayCost ToCost(const core::Speed& speed, const core::Steps& steps) {
  return {speed.rays_per_s, speed.slowest, speed.fastest, steps.nodes, steps.triangles};
}

api::TradeoffRow ToRow(const core::MeasuredPair& pair, const core::MeasuredBuild& build,
                       const core::Accuracy& accuracy) {
  api::TradeoffRow row;
  row.build = ToApi(pair.build);
  row.precision = ToApi(pair.precision);
  row.build_ms = build.build_ms;
  row.bytes = build.bytes;
  row.sah_cost = build.sah_cost;
  row.random = ToCost(pair.random, build.random);
  row.aimed = ToCost(pair.aimed, build.aimed);
  if (accuracy.leaks) row.leaks = ToRate(*accuracy.leaks);
  row.wrong_triangles = ToRate(accuracy.wrong_triangles);
  row.unconnected_triangles = ToRate(accuracy.unconnected_triangles);
  row.folds = ToRate(accuracy.folds);
  row.missed_hits = ToRate(accuracy.missed_hits);
  row.extra_hits = ToRate(accuracy.extra_hits);
  row.differences = ToRate(pair.differences);
  row.t_error_rays = accuracy.t_error.rays;
  row.t_error_p999 = accuracy.t_error.p999;
  row.t_error_max = accuracy.t_error.max;
  row.t_error_bound = core::TraitsOf(pair.precision).t_error;
  return row;
}

}  // namespace

api::Tradeoff ToApi(const core::MeasuredTradeoff& measured) {
  const core::Tradeoff& from = measured.tradeoff;
  api::Tradeoff tradeoff;
  tradeoff.ready = true;
  tradeoff.progress = 1;
  tradeoff.measured_at = Rfc3339(measured.measured_ms);
  tradeoff.triangles = from.triangles;
  tradeoff.closed = from.closed;
  tradeoff.aimed_from_inside = from.from_inside;
  tradeoff.threads = from.threads;
  tradeoff.load_average = from.load_average;
  tradeoff.runs = from.runs;
  tradeoff.disturbed_runs = from.disturbed_runs;
  tradeoff.seed = from.seed;
  tradeoff.total_ms = from.total_ms;
  for (const core::MeasuredPair& pair : from.pairs) {
    const auto build = std::find_if(from.builds.begin(), from.builds.end(),
                                    [&](const auto& b) { return b.build == pair.build; });
    const auto accuracy =
        std::find_if(from.precisions.begin(), from.precisions.end(),
                     [&](const auto& a) { return a.precision == pair.precision; });
    if (build == from.builds.end() || accuracy == from.precisions.end()) continue;
    tradeoff.results.push_back(ToRow(pair, *build, *accuracy));
  }
  return tradeoff;
}

}  // namespace kdray::server
