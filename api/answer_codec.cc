// SPDX-License-Identifier: Apache-2.0
#include "api/answer_codec.h"

#include <cmath>
#include <utility>

#include "api/json_text.h"
#include "api/json_value.h"
#include "api/names.h"

namespace kdray::api {
namespace {

using Json = JsonValue;  // in the contract's order, for people who read answers

/// A file may have a coordinate of -0; no answer has.
Vec3 WithoutNegativeZero(const Vec3& v) { return {v[0] + 0.0, v[1] + 0.0, v[2] + 0.0}; }

Json BoxJson(const Box& box) {
  return {{"min", Json::Array(WithoutNegativeZero(box.min))},
          {"max", Json::Array(WithoutNegativeZero(box.max))}};
}

Json HealthJson(const MeshHealth& health) {
  return {{"degenerate", health.degenerate},
          {"duplicate", health.duplicate},
          {"concave", health.concave},
          {"open_edges", health.open_edges},
          {"non_manifold_edges", health.non_manifold_edges},
          {"closed", health.closed},
          {"coordinate_resolution", health.coordinate_resolution}};
}

Json MeshJson(const TreeDescription& tree) {
  const MeshDescription& mesh = tree.mesh;
  if (!tree.mesh_known) return {{"sha256", mesh.sha256}, {"bytes", mesh.bytes}};
  Json json = {{"sha256", mesh.sha256},
               {"format", Name(mesh.format)},
               {"bytes", mesh.bytes},
               {"triangles", mesh.triangles},
               {"dropped", mesh.dropped},
               {"vertices", mesh.vertices},
               {"bounds", BoxJson(mesh.bounds)},
               {"health", HealthJson(mesh.health)}};
  if (mesh.groups) json.Add("groups", Json::Array(*mesh.groups));
  if (mesh.area) json.Add("area", *mesh.area);
  if (mesh.volume) json.Add("volume", *mesh.volume + 0.0);
  return json;
}

Json TreeJson(const TreeFacts& tree) {
  return {{"build", Name(tree.build)},
          {"nodes", tree.nodes},
          {"leaves", tree.leaves},
          {"empty_leaves", tree.empty_leaves},
          {"references", tree.references},
          {"max_depth", tree.max_depth},
          {"leaf_histogram", Json::Array(tree.leaf_histogram)},
          {"max_leaf", tree.max_leaf},
          {"bytes", tree.bytes},
          {"sah_cost", tree.sah_cost},
          {"traversal_cost", tree.traversal_cost},
          {"intersection_cost", tree.intersection_cost},
          {"parse_ms", tree.parse_ms},
          {"build_ms", tree.build_ms}};
}

Json DescriptionJson(const TreeDescription& tree) {
  Json json = {{"id", tree.id},
               {"state", tree.ready ? "ready" : "building"},
               {"progress", tree.progress},
               {"created_at", tree.created_at},
               {"mesh", MeshJson(tree)}};
  if (tree.tree) json.Add("tree", TreeJson(*tree.tree));
  if (!tree.plan.empty()) json.Add("plan", tree.plan);
  return json;
}

/// 4000000, not 4000000.0: most limits count something.
Json PlainNumber(double value) {
  if (std::trunc(value) == value && std::fabs(value) < 9007199254740992.0) {
    return static_cast<std::int64_t>(value);
  }
  return value;
}

void AppendCorner(std::string* out, const Vec3& corner) {
  *out += '[';
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (axis != 0) *out += ',';
    AppendNumber(out, corner[axis]);
  }
  *out += ']';
}

Json RateJson(const ErrorRate& rate) {
  const auto rays = static_cast<double>(rate.rays);
  Json json = {{"count", rate.count},
               {"rays", rate.rays},
               {"rate", rate.rays == 0 ? 0.0 : static_cast<double>(rate.count) / rays}};
  // Nothing seen among n says with 95% confidence that the rate is below 3/n ("rule of three").
  if (rate.count == 0) json.Add("below", rate.rays <= 3 ? 1.0 : 3.0 / rays);
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
            {"bound", row.t_error_bound}}}};
}

}  // namespace

std::string EncodeDescription(const TreeDescription& tree) { return DescriptionJson(tree).text(); }

std::string EncodePage(const TreePage& page) {
  Json trees = Json::Array(std::vector<Json>());
  for (const TreeDescription& tree : page.trees) trees.Append(DescriptionJson(tree));
  return Json{{"trees", trees}, {"next", page.next}}.text();
}

std::string EncodeCells(const std::vector<Cell>& cells) {
  // Written directly, because there may be a hundred thousand.
  std::string out = "{\"cells\":[";
  for (const Cell& cell : cells) {
    if (out.back() == '}') out += ',';
    out += "{\"min\":";
    AppendCorner(&out, cell.bounds.min);
    out += ",\"max\":";
    AppendCorner(&out, cell.bounds.max);
    out += ",\"depth\":";
    AppendInteger(&out, cell.depth);
    out += cell.leaf ? ",\"leaf\":true,\"triangles\":" : ",\"leaf\":false,\"triangles\":";
    AppendInteger(&out, static_cast<std::int64_t>(cell.triangles));
    out += '}';
  }
  return out + "]}";
}

std::string EncodeTradeoff(const Tradeoff& tradeoff) {
  if (!tradeoff.ready) {
    return Json{{"state", "measuring"}, {"progress", tradeoff.progress}}.text();
  }
  Json results = Json::Array(std::vector<Json>());
  for (const TradeoffRow& row : tradeoff.results) results.Append(RowJson(row));
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
              {"results", results}}
      .text();
}

std::string EncodeCapabilities(std::string_view version, const Limits& limits) {
  return Json{{"name", "kdray"},
              {"version", version},
              {"formats", Json::Array(kMeshFormatNames)},
              {"builds", Json::Array(kBuildNames)},
              {"precisions", Json::Array(kPrecisionNames)},
              {"limits",
               {{"max_upload_bytes", limits.max_upload_bytes},
                {"max_rays", limits.max_rays},
                {"max_hits", kMaxHits},
                {"max_answer_hits", limits.MaxAnswerHits()},
                {"max_pixels", limits.max_pixels},
                {"max_image_side", limits.max_image_side},
                {"max_cells", limits.max_cells},
                {"max_picture_cells", limits.max_picture_cells},
                {"max_samples", limits.max_samples},
                {"max_deadline_ms", limits.max_deadline_ms},
                {"max_wait_ms", limits.max_wait_ms},
                {"max_batch_bytes", limits.MaxBatchBytes()},
                {"max_json_body_bytes", limits.max_json_body_bytes},
                {"max_json_depth", limits.max_json_depth}}}}
      .text();
}

std::string EncodeProblem(const Problem& problem, std::string_view request_id) {
  const ErrorRow& row = RowOf(problem.code);
  Json json = {{"type", "/problems/" + std::string(Name(row.code))},
               {"title", row.title},
               {"status", row.status},
               {"detail", problem.detail},
               {"code", Name(row.code)},
               {"request_id", request_id}};
  if (problem.parameter) json.Add("parameter", *problem.parameter);
  if (problem.limit) json.Add("limit", PlainNumber(*problem.limit));
  if (problem.actual) json.Add("actual", PlainNumber(*problem.actual));
  if (problem.line) json.Add("line", *problem.line);
  return std::move(json).text();
}

}  // namespace kdray::api
