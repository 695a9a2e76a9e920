// SPDX-License-Identifier: Apache-2.0
// Lights: as a caller describes them, and as the shader uses them.
#pragma once

#include <cstdint>

#include "core/geometry/bounds3.h"
#include "core/geometry/vec3.h"
#include "core/render/color.h"

namespace kdray::core {

enum class LightKind : std::uint8_t {
  kDirectional,  ///< from infinitely far, as the sun
  kPoint,        ///< from one point to all sides
};

/// A surface that faces a light of intensity 1 and colour 1,1,1 reflects its own colour. From a
/// point light that holds at the distance of the diagonal of the mesh's bounds; light falls off
/// with the square of the distance.
struct Light {
  LightKind kind = LightKind::kDirectional;
  Vec3d vector = {0, 0, -1};  ///< kDirectional: where the light travels to, any length, not 0;
                              ///< kPoint: where it stands, world units
  double intensity = 1;       ///< >= 0
  Rgb color = {1, 1, 1};      ///< sRGB
  friend bool operator==(const Light&, const Light&) = default;
};

/// One light, prepared. Immutable, so safe from many threads at once.
class LightSource {
 public:
  LightSource(const Light& light, const Bounds3d& bounds);

  bool is_point() const { return is_point_; }

  /// What a point of a surface receives.
  struct Arrival {
    Vec3d to_light;  ///< unit; zero if no light arrives
    double r = 0, g = 0, b = 0;
  };
  Arrival At(const Vec3d& point) const;

  /// The light's place; for point lights.
  const Vec3d& place() const { return vector_; }

 private:
  bool is_point_;
  Vec3d vector_;  // unit, to the light; or the light's place
  double diagonal_;
  double r_, g_, b_;  // linear, times intensity
};

}  // namespace kdray::core
