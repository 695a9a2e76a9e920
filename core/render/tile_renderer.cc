// SPDX-License-Identifier: Apache-2.0
#include "core/render/tile_renderer.h"

#include <algorithm>

#include "core/render/centre_values.h"
#include "core/render/pixel_order.h"

namespace kdray::core {
namespace {

void Store(std::span<float> pixel, const Rgba& c) {
  pixel[0] = c.r;
  pixel[1] = c.g;
  pixel[2] = c.b;
  pixel[3] = c.a;
}

}  // namespace

TileRenderer::TileRenderer(const Scene& scene, const TraceOptions& trace_options, ScratchPool* pool,
                           RenderedImage* image)
    : scene_(scene), trace_options_(trace_options), pool_(pool), image_(image) {}

void TileRenderer::SetLines(CellLines lines) {
  const Rgb linear = SrgbToLinear(lines.style().color);
  line_color_ = {linear.r, linear.g, linear.b, 1.0f};
  lines_ = std::move(lines);
}

Status TileRenderer::RenderCentres(const Tile& tile) const {
  const ScratchPool::Lease scratch(pool_);
  scratch.get()->counts.camera_rays += tile.pixel_count();
  std::vector<Hit>& hits = scratch.get()->hits;
  if (Status status =
          core::RenderCentres(scene_, trace_options_, tile, image_, &scratch.get()->rays, &hits);
      !status.ok()) {
    return status;
  }
  return lines_ ? DrawLines(tile, hits) : Status();
}

Status TileRenderer::DrawLines(const Tile& tile, std::span<const Hit> hits) const {
  std::vector<Hit> in_rows(tile.pixel_count());
  const Hit* hit = hits.data();
  ForEachInPixelOrder(tile.width(), tile.height(), [&](int x, int y) {
    in_rows[static_cast<std::size_t>(y * tile.width() + x)] = *hit++;
  });
  std::vector<float> opacity(tile.pixel_count());
  if (Status status = FindLines(tile, in_rows, 1, opacity); !status.ok()) return status;
  auto line = opacity.begin();
  for (int y = tile.y0; y < tile.y1; ++y) {
    for (int x = tile.x0; x < tile.x1; ++x) DrawLine(*line++, x, y);
  }
  return {};
}

Status TileRenderer::FindLines(const Tile& tile, std::span<const Hit> hits, int samples,
                               std::span<float> opacity) const {
  return lines_->Draw(tile, hits, samples, opacity, trace_options_.cancel);
}

void TileRenderer::DrawLine(float opacity, int x, int y) const {
  if (image_->lines) {
    (*image_->lines)(x, y)[0] = opacity;
  } else if (opacity > 0.0f) {
    const std::span<float> under = std::get<Film<float>>(image_->values)(x, y);
    Store(under, Over(line_color_ * opacity, {under[0], under[1], under[2], under[3]}));
  }
}

}  // namespace kdray::core
