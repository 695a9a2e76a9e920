// SPDX-License-Identifier: Apache-2.0
#include "core/render/shading.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/render/sampler.h"

namespace kdray::core {

Vec3d UnitNormal(const TriangleMesh& mesh, PrimitiveId id) {
  // Local and world axes differ by a positive factor and a shift, so they share normals.
  const Vec3d a = mesh.LocalCorner(id, 0);
  Vec3d e1 = mesh.LocalCorner(id, 1) - a;
  Vec3d e2 = mesh.LocalCorner(id, 2) - a;
  // Edges are first scaled to about 1: the product of two edges of 1e-160 would underflow.
  const double size1 = MaxAbs(e1);
  const double size2 = MaxAbs(e2);
  if (!(size1 > 0 && size2 > 0)) return {};
  e1 = {e1.x / size1, e1.y / size1, e1.z / size1};
  e2 = {e2.x / size2, e2.y / size2, e2.z / size2};
  const Vec3d normal = Cross(e1, e2);
  return MaxAbs(normal) > 0 ? NormalizedAtAnyScale(normal) : Vec3d{};
}

double DiagonalOf(const Bounds3d& bounds) {
  const Vec3d extent = bounds.Extent();
  const double side = MaxAbs(extent);
  if (!(side > 0)) return 0;
  return side * Length(Vec3d{extent.x / side, extent.y / side, extent.z / side});
}

double DefaultAoRadius(const Bounds3d& bounds) { return 0.1 * DiagonalOf(bounds); }

Rgb HashedColor(PrimitiveId id) {
  const std::uint64_t bits = MixBits(id);
  const auto share = [&](int shift) {
    return static_cast<float>(bits >> shift & 0xffff) / 65536.0f;
  };
  const float hue = share(0) * 6.0f;
  const float value = 0.6f + 0.4f * share(16);
  const float chroma = value * (0.5f + 0.4f * share(32));
  // HSV: each channel is full within a sixth of the hue circle around its own hue.
  const auto channel = [&](float own_hue) {
    const float apart = std::abs(hue - own_hue);
    const float distance = std::min(apart, 6.0f - apart);
    return value - chroma * std::clamp(distance - 1.0f, 0.0f, 1.0f);
  };
  return {channel(0), channel(2), channel(4)};
}

}  // namespace kdray::core
