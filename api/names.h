// The wire names of the contract's enumerations. Every list is in the order of the enumerators.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>

#include "api/types.h"

namespace kdray::api {

inline constexpr std::array<std::string_view, 7> kBuildNames = {
    "auto", "kd-sah", "kd-binned", "kd-cyclic", "kd-median", "bvh", "box"};
inline constexpr std::array<std::string_view, 5> kPrecisionNames = {"auto", "fast", "watertight",
                                                                    "double", "exact"};
inline constexpr std::array<std::string_view, 2> kNumberTypeNames = {"f4", "f8"};
inline constexpr std::array<std::string_view, 6> kRayFieldNames = {"t", "triangle", "u",
                                                                   "v", "normal",   "point"};
inline constexpr std::array<std::string_view, 2> kProjectionNames = {"perspective", "orthographic"};
inline constexpr std::array<std::string_view, 4> kRenderModeNames = {"shaded", "normal", "depth",
                                                                     "triangle"};
inline constexpr std::array<std::string_view, 3> kStoppedNames = {"done", "noise", "budget"};
/// Mesh formats that are read in this version.
inline constexpr std::array<std::string_view, 4> kMeshFormatNames = {"obj", "ply", "stl", "off"};

constexpr std::string_view Name(Build build) {
  return kBuildNames[static_cast<std::size_t>(build)];
}
constexpr std::string_view Name(Precision precision) {
  return kPrecisionNames[static_cast<std::size_t>(precision)];
}
constexpr std::string_view Name(NumberType type) {
  return kNumberTypeNames[static_cast<std::size_t>(type)];
}
constexpr std::string_view Name(RayField field) {
  return kRayFieldNames[static_cast<std::size_t>(field)];
}
constexpr std::string_view Name(Projection projection) {
  return kProjectionNames[static_cast<std::size_t>(projection)];
}
constexpr std::string_view Name(RenderMode mode) {
  return kRenderModeNames[static_cast<std::size_t>(mode)];
}

constexpr std::string_view Name(Stopped stopped) {
  return kStoppedNames[static_cast<std::size_t>(stopped)];
}

std::optional<Build> ParseBuild(std::string_view name);

}  // namespace kdray::api
