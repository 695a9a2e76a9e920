// SPDX-License-Identifier: Apache-2.0
// Draws the edges of the mesh's faces as thin lines, hidden where a surface is in front.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/render/camera.h"
#include "core/render/color.h"
#include "core/render/film.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::core {

/// Which sides of a triangle are edges of the file's face: bit k for the side from corner k to
/// corner (k + 1) % 3. The other sides are diagonals of a polygon. Safe from many threads at once.
using SidesOfTriangle = std::function<std::uint8_t(PrimitiveId)>;
inline constexpr std::uint8_t kAllSides = 7;

/// The look of the lines. The width is the same in every image.
inline constexpr Rgb kEdgeColor = {0.05f, 0.06f, 0.09f};  // sRGB
inline constexpr double kEdgeWidthPx = 1.2;
inline constexpr float kEdgeOpacity = 0.9f;

/// Finds lines tile by tile, without a list of all edges: a pixel shows the edges of the triangles
/// that the centre rays of the pixel and of its 8 neighbours in the whole image hit, as far as the
/// pixel's own triangle does not hide them. So the memory does not grow with the mesh, and a value
/// depends neither on the tile nor on the region. An edge of triangles that all lie between the
/// pixels' centres is not drawn. Works in every projection: near a pixel, a spherical image is
/// drawn as its flat camera (Camera::FlatAt). Immutable, so safe from many threads at once. Source
/// of the idea: Baerentzen, Nielsen, Gjol, Larsen, "Two Methods for Antialiased Wireframe Drawing
/// with Hidden Line Removal", SCCG 2008.
class EdgeLines {
 public:
  /// Scene and camera must outlive it.
  EdgeLines(const Scene& scene, const Camera& camera, SidesOfTriangle sides);

  /// Opacity of the lines for each pixel of `tile`, row by row. Traces the centres of the tile and
  /// of one pixel around it. Errors: kCancelled, kDeadlineExceeded.
  Result<std::vector<float>> Draw(const Tile& tile, const TraceOptions& options) const;

 private:
  struct Surface;
  float Strongest(const Camera& flat, double x_px, double y_px, PrimitiveId triangle,
                  const Surface* own) const;

  const Scene& scene_;
  const Camera& camera_;
  const SidesOfTriangle sides_;
};

}  // namespace kdray::core
