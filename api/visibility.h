// SPDX-License-Identifier: Apache-2.0
// The types of visibility between two point sets.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "api/names.h"
#include "api/types.h"

namespace kdray::api {

/// A decoded pair of point sets.
struct PointSets {
  std::vector<Vec3> from, to;
  NumberType number_type = NumberType::kF8;  ///< the request's
};

/// Query parameters of visibility.
struct VisibilityOptions {
  Precision precision = Precision::kAuto;
  Cull cull = Cull::kNone;
  std::optional<double> t_min, t_max;      ///< nullopt: auto
  bool to_directions = false;              ///< `to` has directions
  std::optional<std::int64_t> from_count;  ///< rows of a .npy array that are `from`
  bool bits = false;                       ///< eight answers in a byte
  std::int64_t deadline_ms = 30000;
};

/// What `from` points see, row by row.
struct VisibilityAnswer {
  Precision precision = Precision::kAuto;  ///< the one used, never kAuto
  std::optional<double> offset;            ///< with an end that is auto: the contract's B
  /// 0 or 1 for each pair; or with `bits` ceil(to / 8) bytes a row, the first
  /// in the highest bit.
  std::vector<std::uint8_t> visible;
  std::vector<std::uint64_t> invalid;  ///< numbered through `from`, then `to`; ascending
  double trace_ms = 0;
};

}  // namespace kdray::api
