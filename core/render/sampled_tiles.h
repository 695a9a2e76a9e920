// SPDX-License-Identifier: Apache-2.0
// Renders tiles of the modes that may take several samples: rays, hits, values, sums, pixels.
// core/render/tile_renderer.h renders the other modes; core/render/renderer.h calls both.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/render/camera_rays.h"
#include "core/render/four.h"
#include "core/render/pixel_sums.h"
#include "core/render/renderer.h"
#include "core/render/shader.h"
#include "core/render/srgb_codes.h"
#include "core/render/tile_renderer.h"
#include "core/render/tile_scratch.h"

namespace kdray::core {

/// For kShaded, kNormal and kAmbientOcclusion. Tiles write to different pixels of the image's
/// films, so different threads may render different tiles. All arguments must outlive it.
class SampledTiles {
 public:
  SampledTiles(const Scene& scene, const RenderSpec& spec, const SamplingRule& rule,
               const TraceOptions& trace_options, const TileRenderer& lines, ScratchPool* pool,
               RenderedImage* image);

  /// Renders a tile whose pixels take their centre as the one sample.
  Status RenderCentres(const Tile& tile) const;

  static TileSums Begin(const Tile& tile);
  /// Brings every pixel that has not stopped to `target` samples, and stops those that have enough.
  Status Refine(int target, TileSums* sums) const;
  /// Renders a tile by the default rule: pixels whose surroundings look the same at all nine
  /// centres of the pixel and its neighbours in the whole image take their centre as the one
  /// sample, the others take kSmoothSamples.
  Status RenderSmooth(TileSums* sums) const;
  /// Writes the pixels into the films.
  void Write(const TileSums& sums) const;

 private:
  // Samples of one pixel that follow each other in a batch.
  struct Run {
    std::uint32_t pixel;  // in the tile's rows
    std::uint32_t count;
  };

  void AddRays(const Tile& tile, std::uint32_t pixel, std::uint32_t first, std::uint32_t count,
               TileScratch* scratch) const;
  Status Trace(const RayBatch& rays, TileScratch* scratch) const;
  Status TraceCentres(const Tile& tile, TileScratch* scratch) const;
  Status FinishBatch(int target, std::span<const Run> runs, TileScratch* scratch,
                     TileSums* sums) const;
  Status DrawLines(int samples, std::span<const Hit> hits, TileSums* sums) const;
  void WriteShadedCentres(const Tile& tile, const TileScratch& scratch) const;
  void WritePixel(const PixelSums& pixel, int x, int y) const;
  void FindSteps(const Tile& tile, TileScratch* scratch) const;

  void WriteShaded(const PixelSums& pixel, int x, int y) const;
  void StoreLight(const FourFloats& light, int x, int y) const;
  void WriteNormal(const PixelSums& pixel, int x, int y) const;
  void WriteOcclusion(const PixelSums& pixel, int x, int y) const;

  const Scene& scene_;
  const RenderMode mode_;
  const std::uint64_t seed_;
  const SamplingRule rule_;
  const TraceOptions trace_options_;
  const CameraRays rays_;
  const bool float_rays_;
  const Shader shader_;
  const TileRenderer& lines_;
  ScratchPool* const pool_;
  const SrgbCodes& codes_;
  RenderedImage* const image_;
  Rgba background_;  // linear; all 0 when transparent
  std::array<std::uint8_t, 4> background_codes_;
  double background_luminance_;
};

/// Side of the tiles of RenderSmooth, whose batch has one pixel more on each side.
inline constexpr int kSmoothTileSide = 56;
static_assert(std::size_t{kSmoothTileSide + 2} * (kSmoothTileSide + 2) <= kRaysPerBatch);

}  // namespace kdray::core
