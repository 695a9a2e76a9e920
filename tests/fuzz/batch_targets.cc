// SPDX-License-Identifier: Apache-2.0
// Bodies and queries of requests: batches of rays and points as JSON and .npy, and parameters.
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <variant>

#include "api/batch_codec.h"
#include "api/json_rows.h"
#include "api/npy.h"
#include "api/point_codec.h"
#include "api/query_string.h"
#include "api/request_codec.h"
#include "api/visibility_codec.h"
#include "tests/fuzz/fuzz_target.h"

namespace kdray::fuzz {
namespace {

using nlohmann::json;

api::Limits SmallLimits() {
  api::Limits limits;
  limits.max_rays = 100'000;
  return limits;
}

/// Whether it is valid.
template <class T>
bool CheckProblem(const api::Outcome<T>& outcome) {
  Require(outcome.ok() || !outcome.problem().detail.empty(), "a problem says what is wrong");
  return outcome.ok();
}

void CheckNumbers(const json& row, std::span<const double> numbers) {
  // Rows have ox oy oz dx dy dz and t_min t_max; the table has t_min in place 3.
  static constexpr std::size_t kPlace[] = {0, 1, 2, 4, 5, 6, 3, 7};
  for (std::size_t i = 0; i < row.size(); ++i) {
    const double number = numbers[kPlace[i]];
    if (row[i].is_number()) {
      Require(row[i].get<double>() == number, "a number is that of another reader");
    } else {
      Require(!std::isfinite(number), "a word is not a finite number");
    }
  }
}

bool FuzzRaysAsJson(std::span<const std::byte> input) {
  const std::string_view text = AsText(input);
  const auto rays = api::DecodeRays(text, api::BatchType::kJson, {}, SmallLimits());
  if (!CheckProblem(rays)) return false;
  Require(rays->size() <= SmallLimits().max_rays, "the number of rays is bounded");
  // JSON that is accepted here is JSON to another reader too, with the same numbers.
  const json other = json::parse(text, nullptr, false);
  Require(!other.is_discarded(), "what is accepted is JSON");
  const json& rows = other.at("rays");
  Require(rows.size() == rays->size(), "no row is lost");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    double numbers[api::kRayNumbers];
    rays->Read(i, numbers);
    CheckNumbers(rows[i], numbers);
  }
  return true;
}

bool FuzzNpy(std::span<const std::byte> input) {
  const std::string_view body = AsText(input);
  const auto array = api::ReadNpy(body);
  CheckProblem(array);
  if (array.ok()) {
    std::size_t bytes = array->type == api::NumberType::kF4 ? 4 : 8;
    for (const std::size_t length : array->shape) bytes *= length;
    Require(array->data.size() == bytes, "an array has the elements of its shape");
  }
  const auto rays = api::DecodeRays(body, api::BatchType::kNpy, {}, SmallLimits());
  CheckProblem(rays);
  for (std::size_t i = 0; rays.ok() && i < rays->size(); ++i) {
    if (rays->row_type() == api::NumberType::kF4) {
      float numbers[api::kRayNumbers];
      rays->Read(i, numbers);
    } else {
      double numbers[api::kRayNumbers];
      rays->Read(i, numbers);
    }
  }
  const auto arriving = api::RecogniseRays(body, body.size(), {}, SmallLimits());
  if (arriving && body.size() <= SmallLimits().MaxBatchBytes()) {
    Require(rays.ok(), "what may be decoded while it arrives is an array of rays");
    Require(arriving->rows == rays->size() && arriving->Shape() == rays->shape(), "the same one");
  }
  const bool points = CheckProblem(api::DecodePoints(body, api::BatchType::kNpy, SmallLimits()));
  api::VisibilityOptions options;
  options.from_count = 1;
  CheckProblem(api::DecodePointSets(body, api::BatchType::kNpy, options, SmallLimits()));
  return rays.ok() || points;
}

bool FuzzPointsAsJson(std::span<const std::byte> input) {
  const std::string_view text = AsText(input);
  const auto points = api::DecodePoints(text, api::BatchType::kJson, SmallLimits());
  CheckProblem(points);
  const auto sets = api::DecodePointSets(text, api::BatchType::kJson, {}, SmallLimits());
  CheckProblem(sets);
  if (points.ok() || sets.ok()) Require(json::accept(text), "what is accepted is JSON");
  if (!points.ok()) return sets.ok();
  const json other = json::parse(text);
  const json& rows = other.at("points");
  Require(rows.size() == points->size(), "no row is lost");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!rows[i][axis].is_number()) continue;
      Require(rows[i][axis].get<double>() == points->rows[i][axis],
              "a number is that of another reader");
    }
  }
  return true;
}

bool CheckRender(const api::Outcome<api::RenderRequest>& request, api::ImageForm form) {
  if (!CheckProblem(request)) return false;
  const std::string canonical = api::CanonicalQuery(*request);
  const auto again = api::DecodeRenderQuery(canonical, form, SmallLimits());
  Require(again.ok(), "a canonical query is a query");
  Require(api::CanonicalQuery(*again) == canonical, "a canonical query stays what it is");
  return true;
}

bool FuzzQuery(std::span<const std::byte> input) {
  const std::string_view query = AsText(input);
  const api::Limits limits = SmallLimits();
  CheckProblem(api::ParseQuery(query));
  bool valid = CheckProblem(api::DecodeUpload(query, limits));
  valid |= CheckProblem(api::DecodeList(query, limits));
  valid |= CheckProblem(api::DecodeDescribe(query, limits));
  valid |= CheckProblem(api::DecodeMeasure(query, limits));
  valid |= CheckProblem(api::DecodeCells(query, limits));
  valid |= CheckProblem(api::DecodeClosestOptions(query, limits));
  valid |= CheckProblem(api::DecodeAnyOptions(query, limits));
  valid |= CheckProblem(api::DecodeCountOptions(query, limits));
  valid |= CheckProblem(api::DecodeAllOptions(query, limits));
  valid |= CheckProblem(api::DecodeClosestPointOptions(query, limits));
  valid |= CheckProblem(api::DecodeSideOptions(query, limits));
  valid |= CheckProblem(api::DecodeVisibilityOptions(query, limits));
  for (const auto form : {api::ImageForm::kPng, api::ImageForm::kNpy}) {
    valid |= CheckRender(api::DecodeRenderQuery(query, form, limits), form);
  }
  return valid;
}

bool FuzzRenderBody(std::span<const std::byte> input) {
  const std::string_view body = AsText(input);
  bool valid = false;
  for (const auto form : {api::ImageForm::kPng, api::ImageForm::kNpy}) {
    valid |= CheckRender(api::DecodeRenderBody(body, form, std::nullopt, SmallLimits()), form);
  }
  Require(!valid || json::accept(body), "what is accepted is JSON");
  return valid;
}

std::vector<Bytes> RaySeeds() {
  return {ToBytes(R"({"rays":[[0,0,1,0,0,-1],[0.5,-1e-3,2E+2,1,0,0,0,1e300]]})"),
          ToBytes(R"({"rays":[]})"),
          ToBytes("{ \"rays\" : [ [ 1 , 2 , 3 , 4 , 5 , 6 , 7 , 8e0 ] ] }\n"),
          ToBytes(R"({"rays":[[1,2,3,4,5,6],[0.1,0.2,0.30000000000000004,1e-320,-0,1e22]]})")};
}

std::vector<Bytes> PointSeeds() {
  return {ToBytes(R"({"points":[[0,0,1],[0.5,-1e-3,2E+2]]})"), ToBytes(R"({"points":[]})"),
          ToBytes(R"({"from":[[0,0,1]],"to":[[1,2,3],[4,5,6]]})")};
}

std::vector<Bytes> NpySeeds() {
  std::vector<Bytes> seeds;
  const std::string floats(6 * 4 * 2, '\0'), doubles(8 * 8 * 4, '\1');
  const std::size_t two_rays[] = {2, 6}, grid[] = {2, 2, 8}, points[] = {4, 3};
  seeds.push_back(ToBytes(api::NpyHeader("'<f4'", two_rays) + floats));
  seeds.push_back(ToBytes(api::NpyHeader("'<f8'", grid) + doubles));
  seeds.push_back(ToBytes(api::NpyHeader("'<f4'", points) + floats));
  std::string fortran = api::NpyHeader("'<f8'", grid) + doubles;
  fortran.replace(fortran.find("False"), 5, "True ");
  seeds.push_back(ToBytes(fortran));
  return seeds;
}

std::vector<Bytes> QuerySeeds() {
  return {ToBytes("precision=exact&fields=t,triangle,normal&t_min=auto&dtype=f8&cull=back"),
          ToBytes("max_hits=10&deadline_ms=100&t_max=1e+5"),
          ToBytes("build=bvh"),
          ToBytes("limit=10&mesh=" + std::string(64, '0')),
          ToBytes("depth=3"),
          ToBytes("width=64&height=48&mode=depth&depth_range=0,1&eye=1,2,3&target=0,0,0&up=0,0,1"),
          ToBytes("mode=shaded&shadows=true&samples=4&background=transparent&color=0.5,0.5,1"),
          ToBytes("projection=orthographic&view=front&view_height=2&region=0,0,8,8"),
          ToBytes("mode=ambient-occlusion&seed=7&samples=16&edges=true")};
}

std::vector<Bytes> RenderBodySeeds() {
  return {ToBytes(R"({"width":64,"height":48,"mode":"normal","eye":[1,2,3],"target":[0,0,0]})"),
          ToBytes(R"({"lights":[{"direction":[0,0,1],"intensity":2}],"shadows":true})"),
          ToBytes(R"({"intrinsic":[500,500,320,240],)"
                  R"("extrinsic":[1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1]})")};
}

const FuzzTarget kTargets[] = {{"rays_json", FuzzRaysAsJson, RaySeeds},
                               {"points_json", FuzzPointsAsJson, PointSeeds},
                               {"npy", FuzzNpy, NpySeeds},
                               {"query", FuzzQuery, QuerySeeds},
                               {"render_body", FuzzRenderBody, RenderBodySeeds}};

}  // namespace

std::span<const FuzzTarget> BatchTargets() { return kTargets; }

}  // namespace kdray::fuzz
