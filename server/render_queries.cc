// SPDX-License-Identifier: Apache-2.0
#include "server/render_queries.h"

#include <algorithm>
#include <chrono>
#include <utility>
#include <vector>

#include "core/base/elapsed.h"
#include "core/io/png_writer.h"
#include "core/render/depth_range.h"
#include "core/render/picture.h"
#include "core/render/renderer.h"
#include "server/mapping.h"

namespace kdray::server {
namespace {

using SteadyClock = std::chrono::steady_clock;

/// For a picture that must be ready by the deadline: a fifth of the remaining time is for encoding.
std::chrono::milliseconds TimeToTrace(const core::CancelToken& cancel) {
  if (cancel.deadline() == SteadyClock::time_point::max()) return std::chrono::milliseconds::max();
  const auto left =
      std::chrono::duration_cast<std::chrono::milliseconds>(cancel.deadline() - SteadyClock::now());
  return std::max(left * 4 / 5, std::chrono::milliseconds(1));
}

/// Sets what the request takes from the mesh's file; `attributes` must outlive the spec.
void AddSurface(const api::RenderRequest& request, const core::MeshAttributes* attributes,
                core::RenderSpec* spec) {
  if (request.edges) {
    spec->edges = [attributes](core::PrimitiveId id) { return attributes->Edges(id); };
  }
  if (request.smooth && attributes->has(core::AttributeKind::kShadingNormal)) {
    spec->smooth_normals = [attributes](core::PrimitiveId id, double u, double v) {
      return attributes->ShadingNormal(id, u, v);
    };
  }
  if (request.file_color && attributes->has(core::AttributeKind::kColor)) {
    spec->file_colors = [attributes](core::PrimitiveId id, double u, double v) {
      return attributes->Color(id, u, v);
    };
  }
}

core::RenderSpec MakeSpec(const RenderQuery& query) {
  core::RenderSpec spec = ToCore(query.request);
  if (!query.request.samples && !query.png) {
    const auto samples = api::DefaultSamples(query.request.mode, api::ImageForm::kNpy);
    if (samples) spec.samples = static_cast<int>(*samples);
  }
  AddSurface(query.request, query.attributes, &spec);
  spec.as_codes = query.png;
  spec.max_cells = static_cast<std::size_t>(query.limits.max_picture_cells);
  if (spec.budget) spec.budget = std::min(*spec.budget, TimeToTrace(query.cancel));
  return spec;
}

api::Problem ToRenderProblem(const core::Error& error, const RenderQuery& query) {
  // Depths were checked before, so only the number of cells can be the cause.
  if (error.field == "cells_depth") {
    return TooManyCells("cells_depth", *query.request.cells_depth, query.limits.max_picture_cells);
  }
  return ToProblem(error);
}

api::Check SetDepthRange(const RenderQuery& query, core::RenderedImage* image,
                         api::RenderAnswer* answer) {
  if (const auto& range = query.request.depth_range) {
    image->depth_range = {(*range)[0], (*range)[1]};
  } else {
    const auto whole = core::RangeOfWholeImage(query.scene, *image, query.cancel);
    if (!whole.ok()) return ToProblem(whole.error());
    image->depth_range = *whole;
  }
  if (const auto& range = image->depth_range) answer->depth_range = {range->near, range->far};
  return std::nullopt;
}

api::Check Encode(core::RenderedImage image, const core::CancelToken& cancel,
                  api::RenderAnswer* answer) {
  const auto start = SteadyClock::now();
  const core::Result<core::Picture> picture = core::MakePicture(std::move(image), cancel);
  if (!picture.ok()) return ToProblem(picture.error());
  core::Result<std::vector<std::byte>> bytes =
      core::EncodePng(picture->pixels, picture->width, picture->height, picture->channels, cancel);
  if (!bytes.ok()) return ToProblem(bytes.error());
  answer->image = *std::move(bytes);
  answer->encode_ms = core::MillisecondsSince(start);
  return std::nullopt;
}

}  // namespace

core::AttributeKinds AttributesFor(const api::RenderRequest& request) {
  core::AttributeKinds kinds;
  if (request.smooth) kinds.Add(core::AttributeKind::kShadingNormal);
  if (request.file_color) kinds.Add(core::AttributeKind::kColor);
  if (request.edges) kinds.Add(core::AttributeKind::kEdges);
  return kinds;
}

api::Check AnswerRender(const RenderQuery& query, api::RenderAnswer* answer) {
  const auto start = SteadyClock::now();
  core::Result<core::RenderedImage> image =
      core::Render(query.scene, MakeSpec(query), query.cancel);
  if (!image.ok()) return ToRenderProblem(image.error(), query);
  if (query.png && query.request.mode == api::RenderMode::kDepth) {
    if (auto problem = SetDepthRange(query, &*image, answer)) return problem;
  }
  answer->precision = ToApi(image->precision);
  answer->samples = image->samples;
  answer->noise = image->noise;
  answer->stopped = ToApi(image->stopped);
  answer->counts = ToApi(image->counts);
  answer->trace_ms = core::MillisecondsSince(start);
  if (query.png) return Encode(*std::move(image), query.cancel, answer);
  answer->image = ToApi(*std::move(image));
  return std::nullopt;
}

}  // namespace kdray::server
