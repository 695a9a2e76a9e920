// The arithmetic of the triangle intersection.
#pragma once

#include <cstdint>
#include <string_view>

#include "core/base/enumerators.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

enum class Precision : std::uint8_t {
  kFast,        ///< float Moeller-Trumbore; may leak at edges
  kWatertight,  ///< float Woop-Benthin-Wald; no leak on a closed mesh; t, u, v in double
  kDouble,      ///< the same in double, with exact edge signs
  kExact,       ///< hits and the order of t are those of the real numbers that were sent
};

constexpr std::string_view Name(Precision precision) {
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
  return {};
}
inline constexpr auto kAllPrecisions = kAll<Precision>;

/// The precision of `auto` for `closest` and `any` on this mesh: watertight if floats represent
/// every vertex exactly and the largest |local coordinate| is less than 2^20 shortest edges; else
/// double.
Precision AutoPrecision(const TriangleMesh& mesh);
/// The same from TriangleMesh::has_double_vertices() and shortest_edge().
Precision AutoPrecision(bool has_double_vertices, double shortest_edge);

}  // namespace kdray::core
