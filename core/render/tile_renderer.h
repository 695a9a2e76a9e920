// Renders one tile of an image: rays, hits, sums, pixels. core/render/renderer.h calls it for all
// tiles.
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
#include "core/render/pixel_sums.h"
#include "core/render/renderer.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::core {

/// The common data of all tiles. Tiles write to different pixels of the image's films, so different
/// threads may render different tiles. Scene and image must outlive it.
class TileRenderer {
 public:
  TileRenderer(const Scene& scene, const RenderSpec& spec, const SamplingRule& rule,
               const CancelToken& cancel, RenderedImage* image);

  void SetLines(CellLines lines);

  /// kDepth and kTriangle: renders the pixels' centres in one step.
  Status RenderCentres(const Tile& tile) const;

  // For kShaded and kNormal.
  static TileSums Begin(const Tile& tile);
  /// Brings every pixel that has not stopped to `target` samples, and stops those that have enough.
  Status Refine(int target, TileSums* sums) const;
  /// Writes the pixels into the films.
  void Write(const TileSums& sums) const;

 private:
  std::vector<Ray> MakeRays(int target, const TileSums& sums) const;
  void AddShaded(std::span<const Ray> rays, std::span<const Hit> hits, PixelSums* pixel) const;
  void AddNormals(std::span<const Hit> hits, PixelSums* pixel) const;
  void WriteShaded(const PixelSums& pixel, std::span<float> values) const;
  void WriteNormal(const PixelSums& pixel, int x, int y) const;
  void DrawLine(float opacity, int x, int y) const;

  const TriangleMesh& mesh_;
  const Scene& scene_;
  const std::uint64_t seed_;
  const SamplingRule rule_;
  const TraceOptions trace_options_;
  const Rgb color_;           // linear
  Rgba background_;           // linear; all 0 when transparent
  double surface_luminance_;  // of the mesh under full light
  double background_luminance_;
  Rgba line_color_;  // linear
  std::optional<CellLines> lines_;
  RenderedImage* const image_;
};

}  // namespace kdray::core
