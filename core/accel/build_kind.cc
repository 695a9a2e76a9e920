#include "core/accel/build_kind.h"

namespace kdray::core {

std::string_view Name(BuildKind kind) {
  switch (kind) {
    case BuildKind::kKdSah:
      return "kd-sah";
    case BuildKind::kKdBinned:
      return "kd-binned";
    case BuildKind::kKdCyclic:
      return "kd-cyclic";
    case BuildKind::kKdMedian:
      return "kd-median";
    case BuildKind::kBvh:
      return "bvh";
    case BuildKind::kBox:
      return "box";
  }
  return "";
}

std::optional<BuildKind> ParseBuildKind(std::string_view name) {
  for (const BuildKind kind : kAllBuildKinds) {
    if (Name(kind) == name) return kind;
  }
  return std::nullopt;
}

BuildKind AutoBuildKind(std::size_t triangle_count) {
  constexpr std::size_t kBoxTriangles = 12;
  return triangle_count <= kBoxTriangles ? BuildKind::kBox : BuildKind::kKdSah;
}

}  // namespace kdray::core
