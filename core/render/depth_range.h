// SPDX-License-Identifier: Apache-2.0
// The range of depths that the greys of a depth picture cover.
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/render/renderer.h"
#include "core/scene/scene.h"

namespace kdray::core {

/// The grey of a hit: 255 at `near`, 1 at `far`, linear between, rounded half up; 255 if near ==
/// far. Depths outside the range are clamped to it.
std::uint8_t GreyOf(const DepthRange& range, float depth);

/// The range of the film's hits; nullopt if no pixel hits. `image` must be of kDepth. Errors:
/// kCancelled, kDeadlineExceeded.
Result<std::optional<DepthRange>> RangeOfFilm(const RenderedImage& image,
                                              const CancelToken& cancel);

/// The range of the hits of the whole image that image.camera sees, of which `image` has a region:
/// traces the other pixels' centres too, so each region has the whole image's range. nullopt if no
/// pixel hits. Needs no memory for the whole image. Works in parallel within the caller's arena.
/// Errors: kCancelled, kDeadlineExceeded.
Result<std::optional<DepthRange>> RangeOfWholeImage(const Scene& scene, const RenderedImage& image,
                                                    const CancelToken& cancel);

}  // namespace kdray::core
