// SPDX-License-Identifier: Apache-2.0
// Sums of a pixel's samples, to which more samples can be added.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/geometry/hit.h"
#include "core/geometry/vec3.h"
#include "core/render/film.h"

namespace kdray::core {

/// Sums over samples in the order of their numbers, so that n samples taken in steps give the bits
/// of n samples taken at once.
struct PixelSums {
  std::uint32_t samples = 0;
  std::uint32_t misses = 0;
  bool stopped = false;  ///< takes no more samples
  Vec3d sum;             ///< of the values of the samples that hit (core/render/shader.h)
  double luminance = 0;  ///< and its squares: only where noise is estimated
  double luminance2 = 0;

  void AddLuminance(double y) {
    luminance += y;
    luminance2 += y * y;
  }
  /// The share of the samples that hit.
  float Coverage() const {
    return static_cast<float>(samples - misses) / static_cast<float>(samples);
  }
  /// Standard error of the mean luminance, from the variance of the samples; infinite for one
  /// sample. Samples are stratified, so the true error is smaller.
  double Noise() const {
    if (samples < 2) return HUGE_VAL;
    const double n = samples;
    const double variance = (luminance2 - luminance * luminance / n) / (n - 1);
    return variance > 0 ? std::sqrt(variance / n) : 0.0;
  }
};

/// The sums of an unfinished tile.
struct TileSums {
  Tile tile;
  std::vector<PixelSums> pixels;    ///< row by row
  std::vector<float> line_opacity;  ///< where lines are drawn; made with the first samples
  std::vector<Hit> line_hits;       ///< while they are traced: of each pixel in turn

  bool is_finished() const {
    for (const PixelSums& pixel : pixels) {
      if (!pixel.stopped) return false;
    }
    return true;
  }
};

/// When pixels stop, apart from time limits.
struct SamplingRule {
  int limit = 1;           ///< samples of a pixel at most
  double max_noise = 0;    ///< 0: takes all samples
  bool centre = false;     ///< the one sample is the pixel's centre
  bool estimates = false;  ///< the noise of every pixel is computed
};

}  // namespace kdray::core
