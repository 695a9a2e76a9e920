// SPDX-License-Identifier: Apache-2.0
// The values of the modes that take one sample, at the centre of each pixel.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "core/base/result.h"
#include "core/geometry/hit.h"
#include "core/render/film.h"
#include "core/render/renderer.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::core {

constexpr bool HasOneSample(RenderMode mode) {
  return mode == RenderMode::kDepth || mode == RenderMode::kTriangle || mode == RenderMode::kCost ||
         mode == RenderMode::kPosition;
}

/// A hit's t as a value of the depth film; a miss (infinity) stays one.
inline float DepthValue(const Hit& hit) {
  constexpr double kLargest = std::numeric_limits<float>::max();
  return hit.IsHit() ? static_cast<float>(std::min(hit.t, kLargest))
                     : std::numeric_limits<float>::infinity();
}

/// Sets `rays` to those through the centres of a tile's pixels, row by row.
void SetCentreRays(const Camera& camera, const Tile& tile, std::vector<Ray>* rays);

/// Writes the values of image->mode, for which HasOneSample, for the pixels of `tile` into
/// image->values. Sets `rays` and `hits`, in the order of ForEachInPixelOrder. `tile` has at most
/// CentreRays::kMostSide pixels a side. Errors: kCancelled, kDeadlineExceeded.
Status RenderCentres(const Scene& scene, const TraceOptions& options, const Tile& tile,
                     RenderedImage* image, std::vector<Ray>* rays, std::vector<Hit>* hits);

}  // namespace kdray::core
