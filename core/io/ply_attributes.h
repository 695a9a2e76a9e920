// SPDX-License-Identifier: Apache-2.0
// Which properties of a PLY element are attributes of the surface (core/io/attribute_sink.h).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "core/io/attribute_sink.h"
#include "core/io/ply_header.h"

namespace kdray::core {

enum class PlyMeaning : std::uint8_t { kNothing, kUv, kNormal, kColor };
inline constexpr std::size_t kPlyMeanings = 4;

/// What a number of a row is.
struct PlyUse {
  PlyMeaning meaning = PlyMeaning::kNothing;
  int component = 0;
};

/// The uses of an element's properties, for the kinds that a sink wants: texture coordinates (`s
/// t`, `u v`, `texture_u texture_v`, `texture_s texture_t`), normals (`nx ny nz`) and colours
/// (`red green blue`, `diffuse_red …`, `r g b`).
class PlyAttributes {
 public:
  /// Both may be null: then nothing is used.
  PlyAttributes(const PlyElement* element, const AttributeSink* sink);

  bool empty() const { return uses_.empty(); }
  PlyUse of(std::size_t property) const { return uses_.empty() ? PlyUse() : uses_[property]; }
  bool has_uv() const { return has_uv_; }
  bool has_normal() const { return has_normal_; }
  bool has_color() const { return has_color_; }

 private:
  bool Find(const PlyElement& element, PlyMeaning meaning, std::span<const std::string_view> names);

  std::vector<PlyUse> uses_;  // of each property
  bool has_uv_ = false;
  bool has_normal_ = false;
  bool has_color_ = false;
};

/// The value of a colour's full intensity. Fractions mean 1; AttributeSink finds those that mean
/// 255.
double FullPlyColor(PlyType type);

}  // namespace kdray::core
