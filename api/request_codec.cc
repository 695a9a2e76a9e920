// SPDX-License-Identifier: Apache-2.0
#include "api/request_codec.h"

#include <algorithm>

#include "api/batch_type.h"
#include "api/field_use.h"
#include "api/json_reader.h"
#include "api/json_text.h"
#include "api/request_fields.h"

namespace kdray::api {
namespace {

Problem EmptyInterval(double t_min, double t_max, const char* remark, const char* parameter) {
  return Problem{ErrorCode::kInvalidParameter,
                 "t_min (" + NumberText(t_min) + ") is greater than t_max (" + NumberText(t_max) +
                     remark + ")",
                 parameter};
}

Outcome<RayOptions> CheckedRayOptions(Outcome<RayOptions> options) {
  if (!options) return options;
  if (options->auto_t_max) options->t_max = 1;
  // Checked here, because one mistake would make every row of 6 invalid.
  if (options->t_max && !(options->t_min <= *options->t_max)) {
    // t_min is 0 if it was left out; the mistake is then in t_max.
    return EmptyInterval(options->t_min, *options->t_max, options->auto_t_max ? ", auto" : "",
                         options->t_min == 0 ? "t_max" : "t_min");
  }
  return options;
}

/// `has` describes the excess, "a side of"; `limit_name` and `limit` are the bound.
Problem ImageTooLarge(bool is_region, const std::string& has, std::int64_t actual,
                      const std::string& limit_name, std::uint64_t limit) {
  Problem problem{ErrorCode::kImageTooLarge,
                  (is_region ? "the region has " : "the image has ") + has + "; " + limit_name +
                      " is " + std::to_string(limit) +
                      (is_region ? "; ask for smaller regions"
                                 : "; ask for regions of it, one by one, with `region`")};
  problem.limit = static_cast<double>(limit);
  problem.actual = static_cast<double>(actual);
  return problem;
}

/// A depth picture's greys cover the depths of the whole image, or depth_range.
Check CheckDepthRange(const RenderRequest& request, ImageForm form, const std::string& pointer,
                      const Limits& limits) {
  if (request.mode != RenderMode::kDepth || form != ImageForm::kPng) return std::nullopt;
  if (!request.depth_range) {
    const auto pixels = static_cast<std::uint64_t>(request.width * request.height);
    if (!request.region || pixels <= limits.max_pixels) return std::nullopt;
    Problem problem{ErrorCode::kInvalidParameter,
                    "depth_range is required for a region of an image of " +
                        std::to_string(pixels) +
                        " pixels: without it the range is that of the "
                        "whole image, which is found for at most max_pixels, " +
                        std::to_string(limits.max_pixels),
                    pointer + "depth_range"};
    problem.limit = static_cast<double>(limits.max_pixels);
    problem.actual = static_cast<double>(pixels);
    return problem;
  }
  const auto& [near, far] = *request.depth_range;
  if (near <= far) return std::nullopt;
  return Problem{ErrorCode::kInvalidParameter,
                 "depth_range must be near,far with near at most far, not " + NumberText(near) +
                     "," + NumberText(far),
                 pointer + "depth_range"};
}

/// Checks of several fields together. `pointer` is put before the names of fields.
Outcome<RenderRequest> CheckedRender(Outcome<RenderRequest> request, ImageForm form,
                                     const FieldTable<RenderRequest>& table,
                                     const std::string& pointer, const Limits& limits) {
  if (!request) return request;
  if (Check unused = CheckFieldsAreUsed(*request, form, table, pointer)) return *std::move(unused);
  if (request->mode == RenderMode::kPosition && form == ImageForm::kPng) {
    return Problem{ErrorCode::kInvalidParameter, "mode position has no picture: ask for render.npy",
                   pointer + "mode"};
  }
  const Region all{0, 0, request->width, request->height};
  const Region part = request->region.value_or(all);
  if (part.x0 >= part.x1 || part.y0 >= part.y1 || part.x1 > all.x1 || part.y1 > all.y1) {
    return Problem{ErrorCode::kInvalidParameter,
                   "region must be x0,y0,x1,y1 with 0 <= x0 < x1 <= width (" +
                       std::to_string(all.x1) + ") and 0 <= y0 < y1 <= height (" +
                       std::to_string(all.y1) + ")",
                   pointer + "region"};
  }
  if (Check depth = CheckDepthRange(*request, form, pointer, limits)) return *std::move(depth);
  if (request->samples.value_or(1) > 1 && (request->budget_ms || request->max_noise)) {
    return Problem{ErrorCode::kInvalidParameter,
                   "samples says how many there are, budget_ms and max_noise let pixels decide; "
                   "with these, max_samples is the limit",
                   pointer + "samples"};
  }
  const std::int64_t width = part.x1 - part.x0, height = part.y1 - part.y0;
  const std::int64_t side = std::max(width, height), pixels = width * height;
  const bool is_region = request->region.has_value();
  if (static_cast<std::uint64_t>(side) > limits.max_image_side) {
    return ImageTooLarge(is_region, "a side of " + std::to_string(side) + " pixels", side,
                         "max_image_side", limits.max_image_side);
  }
  if (static_cast<std::uint64_t>(pixels) > limits.max_pixels) {
    return ImageTooLarge(is_region, std::to_string(pixels) + " pixels", pixels, "max_pixels",
                         limits.max_pixels);
  }
  return request;
}

}  // namespace

Outcome<UploadRequest> DecodeUpload(std::string_view query, const Limits& limits) {
  return ReadQuery(UploadFields(limits), query);
}

Outcome<ListRequest> DecodeList(std::string_view query, const Limits&) {
  return ReadQuery(ListFields(), query);
}

Outcome<MeasureRequest> DecodeMeasure(std::string_view query, const Limits& limits) {
  return ReadQuery(MeasureFields(limits), query);
}

Outcome<DescribeRequest> DecodeDescribe(std::string_view query, const Limits& limits) {
  return ReadQuery(DescribeFields(limits), query);
}

Outcome<CellsRequest> DecodeCells(std::string_view query, const Limits&) {
  return ReadQuery(CellsFields(), query);
}

Outcome<RayOptions> DecodeClosestOptions(std::string_view query, const Limits& limits) {
  return CheckedRayOptions(ReadQuery(ClosestFields(limits), query));
}

Outcome<RayOptions> DecodeAnyOptions(std::string_view query, const Limits& limits) {
  return CheckedRayOptions(ReadQuery(AnyFields(limits), query));
}

Outcome<PointOptions> DecodeClosestPointOptions(std::string_view query, const Limits& limits) {
  return ReadQuery(ClosestPointFields(limits), query);
}

Outcome<PointOptions> DecodeSideOptions(std::string_view query, const Limits& limits) {
  return ReadQuery(SideFields(limits), query);
}

Outcome<VisibilityOptions> DecodeVisibilityOptions(std::string_view query, const Limits& limits) {
  Outcome<VisibilityOptions> options = ReadQuery(VisibilityFields(limits), query);
  if (!options) return options;
  if (options->to_directions && options->t_max) {
    return Problem{ErrorCode::kInvalidParameter,
                   "t_max is for points; with to_directions rays have no end", "t_max"};
  }
  if (options->t_min && options->t_max && *options->t_min > *options->t_max) {
    return EmptyInterval(*options->t_min, *options->t_max, "", "t_min");
  }
  return options;
}

Outcome<RayOptions> DecodeCountOptions(std::string_view query, const Limits& limits) {
  return CheckedRayOptions(ReadQuery(CountFields(limits), query));
}

Outcome<RayOptions> DecodeAllOptions(std::string_view query, const Limits& limits) {
  return CheckedRayOptions(ReadQuery(AllFields(limits), query));
}

Check CheckNoParameters(std::string_view query) {
  struct Nothing {};
  Outcome<Nothing> read = ReadQuery(FieldTable<Nothing>{}, query);
  return read ? std::nullopt : Check(std::move(read).problem());
}

Outcome<RenderRequest> DecodeRenderQuery(std::string_view query, ImageForm form,
                                         const Limits& limits) {
  const FieldTable<RenderRequest> table = RenderFields(limits);
  return CheckedRender(ReadQuery(table, query), form, table, "", limits);
}

Outcome<RenderRequest> DecodeRenderBody(std::string_view body, ImageForm form,
                                        std::optional<std::string_view> content_type,
                                        const Limits& limits) {
  if (Check problem = CheckJsonContentType(content_type)) return *std::move(problem);
  if (body.size() > limits.max_json_body_bytes) {
    Problem problem{ErrorCode::kBodyTooLarge, "the body has " + std::to_string(body.size()) +
                                                  " bytes; max_json_body_bytes is " +
                                                  std::to_string(limits.max_json_body_bytes)};
    problem.limit = static_cast<double>(limits.max_json_body_bytes);
    problem.actual = static_cast<double>(body.size());
    return problem;
  }
  const Outcome<JsonObject> object = ReadJsonObject(body, limits.max_json_depth);
  if (!object) return object.problem();
  const FieldTable<RenderRequest> table = RenderFields(limits);
  return CheckedRender(ReadObject(table, *object), form, table, "/", limits);
}

std::string CanonicalQuery(const RenderRequest& request) {
  return CanonicalText(RenderFields(Limits{}), request);
}

std::string CanonicalQuery(const CellsRequest& request) {
  return CanonicalText(CellsFields(), request);
}

}  // namespace kdray::api
