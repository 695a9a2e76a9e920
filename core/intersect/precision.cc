#include "core/intersect/precision.h"

namespace kdray::core {

std::string_view Name(Precision precision) {
  switch (precision) {
    case Precision::kFast:
      return "fast";
    case Precision::kWatertight:
      return "watertight";
    case Precision::kDouble:
      return "double";
    case Precision::kExact:
      return "exact";
  }
  return "";
}

std::optional<Precision> ParsePrecision(std::string_view name) {
  for (const Precision precision : kAllPrecisions) {
    if (Name(precision) == name) return precision;
  }
  return std::nullopt;
}

Precision AutoPrecision(const TriangleMesh& mesh) {
  return AutoPrecision(mesh.has_double_vertices(), mesh.shortest_edge());
}

Precision AutoPrecision(bool has_double_vertices, double shortest_edge) {
  if (has_double_vertices) return Precision::kDouble;
  // The largest |local coordinate| is in [0.5, 1): a float then resolves the shortest edge with at
  // least 4 bits.
  return shortest_edge > 0x1p-20 ? Precision::kWatertight : Precision::kDouble;
}

}  // namespace kdray::core
