// SPDX-License-Identifier: Apache-2.0
// The visible difference of two pictures for a person who flips between them.
#pragma once

#include <cstddef>
#include <vector>

namespace kdray::test {

/// Linear light, 0..1, red, green, blue; row by row, top row first.
struct LinearImage {
  int width = 0, height = 0;
  std::vector<float> rgb;  ///< 3 * width * height
};

/// Pixels per degree of the field of view, as in the paper: a 0.7 m wide screen of 3840 pixels at
/// 0.7 m.
inline constexpr double kFlipPixelsPerDegree = 67.0206;

/// FLIP of each pixel, 0 (the same) to 1. Symmetric. Source: Andersson, Nilsson, Akenine-Moeller,
/// Oskarsson, Astrom, Fairchild, "FLIP: A Difference Evaluator for Alternating Images", HPG 2020;
/// its constants throughout. Both images have the same size.
std::vector<float> Flip(const LinearImage& a, const LinearImage& b,
                        double pixels_per_degree = kFlipPixelsPerDegree);

/// The mean over the pixels.
double MeanFlip(const LinearImage& a, const LinearImage& b,
                double pixels_per_degree = kFlipPixelsPerDegree);

}  // namespace kdray::test
