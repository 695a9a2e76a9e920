// SPDX-License-Identifier: Apache-2.0
// Draws the edges of a tree's cells as thin lines, hidden where the mesh is in front (Figure 4 of
// George Tang, "Acceleration Structures", 2019).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/accel/tree_cell.h"
#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/render/camera.h"
#include "core/render/color.h"
#include "core/render/film.h"

namespace kdray::core {

/// The look of lines. The defaults are tuned by eye: thin enough for the mesh to dominate, strong
/// enough for white and black backgrounds.
struct LineStyle {
  Rgb color = {0.06f, 0.31f, 0.76f};  ///< sRGB
  float width_px = 1.2f;  ///< at an image height of up to 640; above, in proportion to the height
  float near_opacity = 0.95f;   ///< of a line at the nearest point of all cells
  float far_opacity = 0.30f;    ///< at the farthest, in proportion to depth between them
  float empty_opacity = 0.25f;  ///< factor for cells without a triangle
};

/// Lines projected once, then drawn tile by tile. The value of a pixel depends only on the pixel,
/// the cells and the camera: not on the region, nor on the order of the cells, because the most
/// opaque line wins. Immutable, so safe from many threads at once.
class CellLines {
 public:
  /// Edges of `cells` (world units) as seen by the camera within `region`. Once `cancel` has
  /// stopped they may be incomplete; Draw() with the same token then returns its error.
  CellLines(std::span<const TreeCell> cells, const Camera& camera, const Region& region,
            const LineStyle& style = {}, const CancelToken& cancel = {});

  /// Opacity of the lines for each pixel of `tile`, row by row. hits: `samples` per pixel, in the
  /// same order, with depths as t. A line is hidden by the share of samples whose surface lies in
  /// front of it. Surfaces less than two pixel sizes in front do not hide it: cells end where the
  /// mesh does, so lines lie in surfaces, while samples lie beside lines. Errors: kCancelled,
  /// kDeadlineExceeded.
  Status Draw(const Tile& tile, std::span<const Hit> hits, int samples, std::span<float> opacity,
              const CancelToken& cancel = {}) const;

  const LineStyle& style() const { return style_; }

 private:
  // A piece of an edge in image coordinates, clipped to the image and a margin.
  struct Segment {
    double x0, y0, x1, y1;
    double w0, w1;  // linear along the segment: 1 / depth in perspective, else depth
    float opacity;
  };

  // Square blocks of the region; each knows the segments that may touch it.
  struct Bins {
    int side = 32;
    int columns = 0, rows = 0;
    std::vector<std::uint32_t> first;  // columns * rows + 1 positions in `segments`
    std::vector<std::uint32_t> segments;
  };

  void AddEdge(const Vec3d& from, const Vec3d& to, float opacity);
  void FillBins(CancelPoll* poll);
  template <class Visit>
  void VisitBins(const Segment& segment, const Visit& visit) const;
  void DrawSegment(const Segment& segment, const Tile& part, const Tile& tile,
                   std::span<const Hit> hits, int samples, std::span<float> opacity,
                   CancelPoll* poll) const;
  float FadeAt(double depth) const;

  Camera camera_;
  Region region_;
  LineStyle style_;
  double reach_px_ = 0;  // from the middle of a line to where it is invisible
  double half_width_px_ = 0;
  double near_depth_ = 0, far_depth_ = 0;  // of all cells
  std::vector<Segment> segments_;
  Bins bins_;
};

}  // namespace kdray::core
