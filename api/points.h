// SPDX-License-Identifier: Apache-2.0
// The types of point queries, as api/types.h has those of rays.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "api/names.h"
#include "api/types.h"

namespace kdray::api {

/// A decoded batch of points. `shape` is the request's leading shape ((N) for JSON); its product is
/// the number of rows.
struct PointTable {
  std::vector<std::size_t> shape;
  std::vector<Vec3> rows;
  NumberType number_type = NumberType::kF8;  ///< the request's, the default `dtype` of the answer

  std::size_t size() const { return rows.size(); }
};

/// Query parameters of a batch of point queries.
struct PointOptions {
  PointPrecision precision = PointPrecision::kAuto;
  std::vector<PointField> fields = {PointField::kDistance, PointField::kPoint,
                                    PointField::kTriangle, PointField::kU,
                                    PointField::kV};  ///< of `closest`, in the requested order
  std::int64_t deadline_ms = 30000;
  std::optional<NumberType>
      dtype;  ///< of the answer's numbers; nullopt: the request's, f8 for JSON
};

/// One row of points/closest. Without a closest point, triangle is -1, and the distance is
/// infinite, or NaN for an invalid row.
struct NearestPoint {
  double distance;
  Vec3 point, normal;  ///< NaN without one; the normal only if it is requested
  double u, v;
  std::int64_t triangle;
};

/// What an answered batch of points has beside its rows.
struct PointReport {
  Precision precision = Precision::kAuto;  ///< the one used, never kAuto
  std::vector<std::uint64_t> invalid;      ///< row numbers of invalid points, ascending
  double trace_ms = 0;                     ///< points in memory to answers in memory
};

}  // namespace kdray::api
