// SPDX-License-Identifier: Apache-2.0
// The structures that a caller can choose.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "core/base/enumerators.h"

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

/// A build in words.
struct BuildKindWords {
  std::string_view name;       ///< in ids, files and the contract
  std::string_view structure;  ///< what it makes: the beginning of a sentence
};
constexpr BuildKindWords WordsFor(BuildKind kind) {
  switch (kind) {
    case BuildKind::kKdSah:
      return {"kd-sah", "A kd-tree by the surface area heuristic, with clipped triangles"};
    case BuildKind::kKdBinned:
      return {"kd-binned",
              "A kd-tree by the surface area heuristic on binned planes, which builds faster"};
    case BuildKind::kKdCyclic:
      return {"kd-cyclic",
              "A kd-tree by the surface area heuristic on centroid planes, its axes in turn"};
    case BuildKind::kKdMedian:
      return {"kd-median", "A kd-tree split at centroid medians, its axes in turn"};
    case BuildKind::kBvh:
      return {"bvh", "A bounding volume hierarchy by the binned surface area heuristic"};
    case BuildKind::kBox:
      return {"box", "One bounding box and then every triangle"};
  }
  return {};
}
constexpr std::string_view Name(BuildKind kind) { return WordsFor(kind).name; }
inline constexpr auto kAllBuildKinds = kAll<BuildKind>;
std::optional<BuildKind> ParseBuildKind(std::string_view name);

}  // namespace kdray::core
