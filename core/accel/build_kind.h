// The structures that a caller can choose.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace kdray::core {

enum class BuildKind : std::uint8_t {
  kKdSah,  ///< SAH kd-tree over clipped triangles: exact candidates in small nodes, bins in larger
           ///< ones
  kKdBinned,  ///< the same with bins in all nodes: builds faster, traverses slower
  kKdCyclic,  ///< SAH over planes through centroids, axes in turn (Tang 2019, Algorithm 1)
  kKdMedian,  ///< planes at the median centroid, axes in turn
  kBvh,       ///< binned-SAH bounding volume hierarchy
  kBox,       ///< one bounding box, then every triangle
};
inline constexpr std::array kAllBuildKinds = {BuildKind::kKdSah,    BuildKind::kKdBinned,
                                              BuildKind::kKdCyclic, BuildKind::kKdMedian,
                                              BuildKind::kBvh,      BuildKind::kBox};

/// "kd-sah", "kd-binned", "kd-cyclic", "kd-median", "bvh", "box".
std::string_view Name(BuildKind kind);
std::optional<BuildKind> ParseBuildKind(std::string_view name);

/// The build of `auto`: a mesh of 12 triangles or fewer needs no tree.
BuildKind AutoBuildKind(std::size_t triangle_count);

}  // namespace kdray::core
