// SPDX-License-Identifier: Apache-2.0
// The arithmetic of the triangle intersection.
#pragma once

#include <cstdint>
#include <optional>
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

/// What a precision is called, and what it promises.
struct PrecisionTraits {
  std::string_view name;
  bool in_float = false;  ///< its test computes in 32-bit floats; else in doubles
  /// Bound of the scaled error of t (TError in core/tradeoff/tradeoff.h), if there is one.
  std::optional<double> t_error = {};
  /// Bound of the error, per axis and in local units, of the origin of a ray that starts beside a
  /// triangle: some roundings of coordinates below 2 in the test's arithmetic. Half of it was
  /// enough for every ray of tests/property/secondary_rays_test.cc, a quarter was not.
  double origin_error = 0;
};
constexpr PrecisionTraits TraitsOf(Precision precision) {
  switch (precision) {
    case Precision::kFast:
      return {.name = "fast", .in_float = true, .origin_error = 0x1p-23};
    case Precision::kWatertight:
      return {.name = "watertight", .in_float = true, .t_error = 1e-6, .origin_error = 0x1p-23};
    case Precision::kDouble:
      return {.name = "double", .t_error = 1e-14, .origin_error = 0x1p-47};
    case Precision::kExact:
      return {.name = "exact", .t_error = 0.0};  // uses the origin as given
  }
  return {};
}
constexpr std::string_view Name(Precision precision) { return TraitsOf(precision).name; }
inline constexpr auto kAllPrecisions = kAll<Precision>;

/// The precision of `auto` for `closest` and `any` on this mesh: watertight if floats represent
/// every vertex exactly and the largest |local coordinate| is less than 2^20 shortest edges; else
/// double.
Precision AutoPrecision(const TriangleMesh& mesh);
/// The same from TriangleMesh::has_double_vertices() and shortest_edge().
Precision AutoPrecision(bool has_double_vertices, double shortest_edge);

}  // namespace kdray::core
