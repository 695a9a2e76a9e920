// SPDX-License-Identifier: Apache-2.0
#include "api/request_fields.h"

#include <algorithm>
#include <limits>
#include <string_view>

#include "api/names.h"
#include "api/tree_id.h"

namespace kdray::api {
namespace {

constexpr ChoiceKind kPrecisionKind = {kPrecisionNames};
constexpr ChoiceKind kPointPrecisionKind = {kPointPrecisionNames};
constexpr TextKind kSha256Kind = {IsSha256, "a SHA-256 as 64 lower-case hexadecimal digits"};

/// The backend knows its cursors; this check only keeps out what could harm a log line.
bool IsCursor(std::string_view text) {
  return text.size() <= 256 &&
         std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c < '\x7f'; });
}
constexpr TextKind kCursorKind = {IsCursor, "the 'next' of the page before"};

IntegerKind UpTo(std::int64_t min, std::uint64_t max) {
  return {min, static_cast<std::int64_t>(max)};
}

template <class Request>
Field<Request> DeadlineField(const Limits& limits) {
  Field<Request> field =
      MemberField("deadline_ms", UpTo(1, limits.max_deadline_ms), &Request::deadline_ms);
  field.shapes_answer = false;
  return field;
}

constexpr std::string_view kAutoWord = "auto";

/// t_min or t_max: a number, or `auto`, which sets `is_auto` and leaves the number.
template <class Number>
Field<RayOptions> IntervalField(std::string_view name, NumberKind kind, Number RayOptions::*number,
                                bool RayOptions::*is_auto) {
  return {name, kind,
          [number, is_auto](RayOptions& options, FieldValue value) {
            options.*is_auto = std::holds_alternative<std::string>(value);
            if (!(options.*is_auto)) field_detail::Assign(options.*number, std::move(value));
          },
          [number, is_auto](const RayOptions& options) -> std::optional<FieldValue> {
            if (options.*is_auto) return std::string(kAutoWord);
            return field_detail::Fetch(options.*number);
          }};
}

/// Three numbers, or the file's colours.
Field<RenderRequest> ColorField() {
  constexpr VectorKind kKind = {.min = 0, .max = 1, .word = "file"};
  return {"color", kKind,
          [](RenderRequest& request, FieldValue value) {
            request.file_color = std::holds_alternative<std::string>(value);
            if (!request.file_color) field_detail::Assign(request.color, std::move(value));
          },
          [kKind](const RenderRequest& request) -> std::optional<FieldValue> {
            if (request.file_color) return std::string(kKind.word);
            return field_detail::Fetch(request.color);
          }};
}

Field<RenderRequest> BackgroundField() {
  constexpr VectorKind kKind = {0, 1, "transparent"};
  return {"background", kKind,
          [](RenderRequest& request, FieldValue value) {
            request.transparent = std::holds_alternative<std::string>(value);
            request.background.reset();
            if (!request.transparent) {
              field_detail::Assign(request.background, std::move(value));
            }
          },
          [kKind](const RenderRequest& request) -> std::optional<FieldValue> {
            if (request.transparent) return std::string(kKind.word);
            return field_detail::Fetch(request.background);
          }};
}

}  // namespace

FieldTable<UploadRequest> UploadFields(const Limits& limits) {
  using R = UploadRequest;
  return {{MemberField("build", ChoiceKind{kBuildNames}, &R::build),
           MemberField("mesh", kSha256Kind, &R::mesh),
           MemberField("wait_ms", UpTo(0, limits.max_wait_ms), &R::wait_ms)}};
}

FieldTable<ListRequest> ListFields() {
  using R = ListRequest;
  return {{MemberField("mesh", kSha256Kind, &R::mesh),
           MemberField("limit", IntegerKind{1, kMaxPage}, &R::limit),
           MemberField("after", kCursorKind, &R::after)}};
}

FieldTable<DescribeRequest> DescribeFields(const Limits& limits) {
  return {{MemberField("wait_ms", UpTo(0, limits.max_wait_ms), &DescribeRequest::wait_ms)}};
}

FieldTable<MeasureRequest> MeasureFields(const Limits& limits) {
  return {{MemberField("wait_ms", UpTo(0, limits.max_wait_ms), &MeasureRequest::wait_ms)}};
}

FieldTable<CellsRequest> CellsFields() {
  FieldTable<CellsRequest> table{
      {MemberField("depth", IntegerKind{0, kMaxDepth}, &CellsRequest::depth)}};
  table.fields[0].required = true;
  return table;
}

FieldTable<RayOptions> AnyFields(const Limits& limits) {
  using R = RayOptions;
  return {{MemberField("precision", kPrecisionKind, &R::precision),
           IntervalField("t_min", NumberKind{.word = kAutoWord}, &R::t_min, &R::auto_t_min),
           IntervalField("t_max", NumberKind{.or_infinity = true, .word = kAutoWord}, &R::t_max,
                         &R::auto_t_max),
           MemberField("cull", ChoiceKind{kCullNames}, &R::cull), DeadlineField<R>(limits),
           MemberField("dtype", ChoiceKind{kNumberTypeNames}, &R::dtype)}};
}

FieldTable<RayOptions> CountFields(const Limits& limits) { return AnyFields(limits); }

FieldTable<RayOptions> ClosestFields(const Limits& limits) {
  FieldTable<RayOptions> table = AnyFields(limits);
  table.fields.insert(table.fields.begin() + 1,
                      MemberField("fields", ChoicesKind{kRayFieldNames}, &RayOptions::fields));
  return table;
}

FieldTable<PointOptions> SideFields(const Limits& limits) {
  using P = PointOptions;
  return {{MemberField("precision", kPointPrecisionKind, &P::precision), DeadlineField<P>(limits),
           MemberField("dtype", ChoiceKind{kNumberTypeNames}, &P::dtype)}};
}

FieldTable<PointOptions> ClosestPointFields(const Limits& limits) {
  FieldTable<PointOptions> table = SideFields(limits);
  table.fields.insert(table.fields.begin() + 1,
                      MemberField("fields", ChoicesKind{kPointFieldNames}, &PointOptions::fields));
  return table;
}

/// An end of the segment between two points: a number, or off the surface.
Field<VisibilityOptions> EndField(std::string_view name,
                                  std::optional<double> VisibilityOptions::*member) {
  constexpr NumberKind kKind = {.min = 0, .max = 1, .word = "auto"};
  return {name, kKind,
          [member](VisibilityOptions& options, FieldValue value) {
            const double* number = std::get_if<double>(&value);
            options.*member = number != nullptr ? std::optional(*number) : std::nullopt;
          },
          [member, kKind](const VisibilityOptions& options) -> std::optional<FieldValue> {
            if (options.*member) return *(options.*member);
            return std::string(kKind.word);
          }};
}

FieldTable<VisibilityOptions> VisibilityFields(const Limits& limits) {
  using V = VisibilityOptions;
  return {{MemberField("precision", kPrecisionKind, &V::precision), EndField("t_min", &V::t_min),
           EndField("t_max", &V::t_max), MemberField("cull", ChoiceKind{kCullNames}, &V::cull),
           MemberField("to_directions", BooleanKind{}, &V::to_directions),
           MemberField("from_count", UpTo(0, 2 * limits.max_rays), &V::from_count),
           MemberField("bits", BooleanKind{}, &V::bits), DeadlineField<V>(limits)}};
}

FieldTable<RayOptions> AllFields(const Limits& limits) {
  FieldTable<RayOptions> table = ClosestFields(limits);
  table.fields.insert(table.fields.begin() + 2,
                      MemberField("max_hits", IntegerKind{1, kMaxHits}, &RayOptions::max_hits));
  return table;
}

FieldTable<RenderRequest> RenderFields(const Limits& limits) {
  using R = RenderRequest;
  constexpr double kInfinity = std::numeric_limits<double>::max();
  return {{
      MemberField("width", IntegerKind{1, kMaxWholeSide}, &R::width),
      MemberField("height", IntegerKind{1, kMaxWholeSide}, &R::height),
      MemberField("projection", ChoiceKind{kProjectionNames}, &R::projection),
      MemberField("eye", VectorKind{}, &R::eye),
      MemberField("target", VectorKind{}, &R::target),
      MemberField("up", VectorKind{}, &R::up),
      MemberField("view", ChoiceKind{kViewNames}, &R::view),
      MemberField("fov_deg", NumberKind{0, 180, true, true}, &R::fov_deg),
      MemberField("view_height", NumberKind{0, kInfinity, true}, &R::view_height),
      MemberField("h_fov_deg", NumberKind{0, 360, true}, &R::h_fov_deg),
      MemberField("v_fov_deg", NumberKind{0, 180, true}, &R::v_fov_deg),
      MemberField("intrinsic", VectorKind{.count = 4}, &R::intrinsic),
      MemberField("extrinsic", VectorKind{.count = 16}, &R::extrinsic),
      MemberField("mode", ChoiceKind{kRenderModeNames}, &R::mode),
      MemberField("depth_range", VectorKind{.count = 2}, &R::depth_range),
      MemberField("samples", UpTo(1, limits.max_samples), &R::samples),
      MemberField("precision", kPrecisionKind, &R::precision),
      ColorField(),
      BackgroundField(),
      MemberField("lights", LightsKind{kMaxLights}, &R::lights),
      MemberField("shadows", BooleanKind{}, &R::shadows),
      MemberField("smooth", BooleanKind{}, &R::smooth),
      MemberField("ao_radius", NumberKind{0, kInfinity, true}, &R::ao_radius),
      MemberField("edges", BooleanKind{}, &R::edges),
      MemberField("cells_depth", IntegerKind{0, kMaxDepth}, &R::cells_depth),
      MemberField("region", IntegersKind{4, 0, kMaxWholeSide}, &R::region),
      MemberField("seed", IntegerKind{0, std::numeric_limits<std::int64_t>::max()}, &R::seed),
      MemberField("budget_ms", UpTo(1, limits.max_deadline_ms), &R::budget_ms),
      MemberField("max_noise", NumberKind{0, 1, true}, &R::max_noise),
      MemberField("max_samples", UpTo(1, limits.max_samples), &R::max_samples),
      DeadlineField<R>(limits),
  }};
}

}  // namespace kdray::api
