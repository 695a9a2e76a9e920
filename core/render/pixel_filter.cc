// SPDX-License-Identifier: Apache-2.0
#include "core/render/pixel_filter.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace kdray::core {

double PixelFilter::ShareBelow(double offset_px) {
  // The integral of a0 + a1 cos x + a2 cos 2x + a3 cos 3x from -pi, over that up to pi.
  constexpr double kA0 = 0.35875, kA1 = 0.48829, kA2 = 0.14128, kA3 = 0.01168;
  constexpr double kPi = std::numbers::pi;
  const double x = std::clamp(offset_px / kRadiusPx, -1.0, 1.0) * kPi;
  const double integral =
      kA0 * (x + kPi) + kA1 * std::sin(x) + kA2 / 2 * std::sin(2 * x) + kA3 / 3 * std::sin(3 * x);
  return integral / (2 * kPi * kA0);
}

PixelFilter::PixelFilter() {
  // By bisection; the second half mirrors the first, so the mean is 0. The last bits of sin differ
  // between libraries; rounded to 2^-20 pixels, the table does not.
  const auto round = [](double x) {
    return static_cast<float>(std::nearbyint(x * 0x1p20) * 0x1p-20);
  };
  std::array<float, kPieces + 1> ends;
  ends[0] = -static_cast<float>(kRadiusPx);
  ends[kPieces / 2] = 0;
  for (std::size_t i = 1; i < kPieces / 2; ++i) {
    const double share = static_cast<double>(i) / kPieces;
    double low = -kRadiusPx;
    double high = 0;
    while (high - low > 0x1p-40) {
      const double middle = 0.5 * (low + high);
      (ShareBelow(middle) < share ? low : high) = middle;
    }
    ends[i] = round(low);
  }
  for (std::size_t i = 0; i < kPieces / 2; ++i) ends[kPieces - i] = -ends[i];
  for (std::size_t i = 0; i < kPieces; ++i) pieces_[i] = {ends[i], ends[i + 1] - ends[i]};
}

const PixelFilter& PixelFilter::Get() {
  static const PixelFilter filter;
  return filter;
}

}  // namespace kdray::core
