// The structures a caller can ask for.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace kdray::core {

enum class BuildKind : std::uint8_t {
  kKdSah,  ///< SAH kd-tree: exact candidates in small nodes, binned ones above, clipped triangles
  kKdBinned,  ///< binned candidates only: builds faster, traverses slower
  kKdCyclic,  ///< the lecture note's Algorithm 1: SAH over centroid planes, axes in turn
  kKdMedian,  ///< centroid median, axes in turn
  kBvh,       ///< binned-SAH bounding volume hierarchy
  kBox,       ///< one bounding box, then every triangle
};
inline constexpr std::array kAllBuildKinds = {BuildKind::kKdSah,    BuildKind::kKdBinned,
                                              BuildKind::kKdCyclic, BuildKind::kKdMedian,
                                              BuildKind::kBvh,      BuildKind::kBox};

/// "kd-sah", "kd-binned", "kd-cyclic", "kd-median", "bvh", "box".
std::string_view Name(BuildKind kind);
std::optional<BuildKind> ParseBuildKind(std::string_view name);

/// What `auto` picks: a mesh of 12 triangles or fewer needs no tree.
BuildKind AutoBuildKind(std::size_t triangle_count);

}  // namespace kdray::core
