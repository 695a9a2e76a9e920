// SPDX-License-Identifier: Apache-2.0
#include "core/render/heat_map.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace kdray::core {
namespace {

constexpr std::array<Rgb, 5> kStops = {
    Rgb{0, 0, 0}, {0.3f, 0, 0.55f}, {0.8f, 0.12f, 0.3f}, {0.98f, 0.6f, 0.05f}, {1, 1, 0.85f}};
constexpr double kLog2OfHottest = 10;

}  // namespace

Rgb HeatColor(std::int32_t nodes_visited, std::int32_t triangles_tested) {
  const double steps = 1.0 + nodes_visited + triangles_tested;
  const double level = std::min(std::log2(steps) / kLog2OfHottest, 1.0);
  const double position = level * (kStops.size() - 1);
  const std::size_t below = std::min(static_cast<std::size_t>(position), kStops.size() - 2);
  const auto share = static_cast<float>(position - static_cast<double>(below));
  const Rgb& a = kStops[below];
  const Rgb& b = kStops[below + 1];
  return {a.r + share * (b.r - a.r), a.g + share * (b.g - a.g), a.b + share * (b.b - a.b)};
}

}  // namespace kdray::core
