// SPDX-License-Identifier: Apache-2.0
// Renders tiles whose pixels take their centre as the one sample, and the lines over any tile.
// core/render/sampled_tiles.h renders those of several samples; core/render/renderer.h calls both.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/render/cell_lines.h"
#include "core/render/color.h"
#include "core/render/film.h"
#include "core/render/renderer.h"
#include "core/render/tile_scratch.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::core {

/// The common data of all tiles. Tiles write to different pixels of the image's films, so different
/// threads may render different tiles. Scene, pool and image must outlive it.
class TileRenderer {
 public:
  TileRenderer(const Scene& scene, const TraceOptions& trace_options, ScratchPool* pool,
               RenderedImage* image);

  void SetLines(CellLines lines);

  /// Modes for which HasOneSample: renders the pixels' centres in one step.
  Status RenderCentres(const Tile& tile) const;

  bool draws_lines() const { return lines_.has_value(); }
  /// The lines' opacity for each pixel of the tile, row by row. hits: `samples` for each pixel, in
  /// the same order (CellLines::Draw).
  Status FindLines(const Tile& tile, std::span<const Hit> hits, int samples,
                   std::span<float> opacity) const;
  /// Draws the lines over pixels of one sample each. hits: of the pixels, in the order of
  /// ForEachInPixelOrder.
  Status DrawLines(const Tile& tile, std::span<const Hit> hits) const;
  /// Draws a line into the image's films.
  void DrawLine(float opacity, int x, int y) const;

 private:
  const Scene& scene_;
  const TraceOptions trace_options_;
  ScratchPool* const pool_;
  Rgba line_color_;  // linear
  std::optional<CellLines> lines_;
  RenderedImage* const image_;
};

}  // namespace kdray::core
