// SPDX-License-Identifier: Apache-2.0
// The colours of a cost picture.
#pragma once

#include <cstdint>

#include "core/render/color.h"

namespace kdray::core {

/// sRGB. The level is log2(1 + nodes + triangles) / 10, at most 1: black at 0, violet (0.3, 0,
/// 0.55) at 1/4, red (0.8, 0.12, 0.3) at 1/2, orange (0.98, 0.6, 0.05) at 3/4, pale yellow (1, 1,
/// 0.85) at 1, linear between. So 1,023 steps or more have the last colour, and colours get lighter
/// with the cost. The scale is the same for every picture, so pictures of different builds compare.
Rgb HeatColor(std::int32_t nodes_visited, std::int32_t triangles_tested);

}  // namespace kdray::core
