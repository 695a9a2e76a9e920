#include "api/tradeoff_codec.h"

#include <nlohmann/json.hpp>

#include "api/names.h"

namespace kdray::api {
namespace {

using Json = nlohmann::ordered_json;  // in the contract's order, for people who read answers

Json RateJson(const ErrorRate& rate) {
  const auto rays = static_cast<double>(rate.rays);
  Json json = {{"count", rate.count},
               {"rays", rate.rays},
               {"rate", rate.rays == 0 ? 0.0 : static_cast<double>(rate.count) / rays}};
  // Nothing seen among n says with 95% confidence that the rate is below 3/n ("rule of three").
  if (rate.count == 0) json["below"] = rate.rays <= 3 ? 1.0 : 3.0 / rays;
  return json;
}

Json CostJson(const RayCost& cost) {
  return {{"rays_per_s", cost.rays_per_s},
          {"slowest", cost.slowest},
          {"fastest", cost.fastest},
          {"nodes_per_ray", cost.nodes_per_ray},
          {"triangles_per_ray", cost.triangles_per_ray}};
}

Json RowJson(const TradeoffRow& row) {
  return {{"build", Name(row.build)},
          {"precision", Name(row.precision)},
          {"build_ms", row.build_ms},
          {"bytes", row.bytes},
          {"sah_cost", row.sah_cost},
          {"random", CostJson(row.random)},
          {"aimed", CostJson(row.aimed)},
          {"leaks", row.leaks ? RateJson(*row.leaks) : Json()},
          {"wrong_triangles", RateJson(row.wrong_triangles)},
          {"unconnected_triangles", RateJson(row.unconnected_triangles)},
          {"folds", RateJson(row.folds)},
          {"missed_hits", RateJson(row.missed_hits)},
          {"extra_hits", RateJson(row.extra_hits)},
          {"differences", RateJson(row.differences)},
          {"t_error",
           {{"rays", row.t_error_rays},
            {"p999", row.t_error_p999},
            {"max", row.t_error_max},
            {"bound", row.t_error_bound ? Json(*row.t_error_bound) : Json()}}}};
}

}  // namespace

std::string EncodeTradeoff(const Tradeoff& tradeoff) {
  if (!tradeoff.ready) {
    return Json{{"state", "measuring"}, {"progress", tradeoff.progress}}.dump();
  }
  Json results = Json::array();
  for (const TradeoffRow& row : tradeoff.results) results.push_back(RowJson(row));
  return Json{{"state", "measured"},
              {"progress", 1},
              {"measured_at", tradeoff.measured_at},
              {"mesh", {{"triangles", tradeoff.triangles}, {"closed", tradeoff.closed}}},
              {"conditions",
               {{"threads", tradeoff.threads},
                {"load_average", tradeoff.load_average},
                {"runs", tradeoff.runs},
                {"disturbed_runs", tradeoff.disturbed_runs},
                {"aimed_from_inside", tradeoff.aimed_from_inside},
                {"seed", tradeoff.seed},
                {"total_ms", tradeoff.total_ms}}},
              {"results", std::move(results)}}
      .dump();
}

}  // namespace kdray::api
