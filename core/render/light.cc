// SPDX-License-Identifier: Apache-2.0
#include "core/render/light.h"

#include <algorithm>

#include "core/render/shading.h"

namespace kdray::core {

LightSource::LightSource(const Light& light, const Bounds3d& bounds)
    : is_point_(light.kind == LightKind::kPoint),
      vector_(is_point_ ? light.vector : -NormalizedAtAnyScale(light.vector)),
      diagonal_(DiagonalOf(bounds)) {
  const Rgb linear = SrgbToLinear(light.color);
  r_ = light.intensity * static_cast<double>(linear.r);
  g_ = light.intensity * static_cast<double>(linear.g);
  b_ = light.intensity * static_cast<double>(linear.b);
}

LightSource::Arrival LightSource::At(const Vec3d& point) const {
  if (!is_point_) return {vector_, r_, g_, b_};
  const Vec3d to = vector_ - point;
  // Scaled first: squares of 1e-170 or 1e170 would leave the range of double.
  const double scale = MaxAbs(to);
  if (!(scale > 0)) return {};
  const Vec3d scaled = {to.x / scale, to.y / scale, to.z / scale};
  const double length = Length(scaled);
  const double ratio = diagonal_ / scale / length;
  // The largest that no product of intensity and colour makes infinite.
  const double share = std::min(ratio * ratio, 1e100);
  constexpr double kMost = 1e200;
  return {scaled * (1 / length), std::min(r_ * share, kMost), std::min(g_ * share, kMost),
          std::min(b_ * share, kMost)};
}

}  // namespace kdray::core
