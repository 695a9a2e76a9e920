// SPDX-License-Identifier: Apache-2.0
// The rows of an array of rays, and how they become the numbers of rays.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "api/npy.h"
#include "api/types.h"

namespace kdray::api {

/// The numbers of a ray in memory: ox oy oz t_min dx dy dz t_max.
inline constexpr std::size_t kRayNumbers = 8;

/// Rows of 6 or 8 numbers, ox oy oz dx dy dz and perhaps t_min t_max.
struct RayRowForm {
  NumberType sent = NumberType::kF4;
  std::size_t columns = 6;
  double t_min = 0, t_max = 0;  ///< of rows of 6

  /// nullopt if the array's last dimension is neither 6 nor 8.
  static std::optional<RayRowForm> Of(const NpyArray& array, double t_min, double t_max);

  std::size_t RowBytes() const { return columns * BytesOf(sent); }
  /// The type in which rows are read: as they were sent. But if a float cannot hold the t_min or
  /// t_max of rows of 6, it is f8, because the interval must not change.
  NumberType RayType() const;
  std::size_t RayBytes() const { return kRayNumbers * BytesOf(RayType()); }

  static std::size_t BytesOf(NumberType type) { return type == NumberType::kF4 ? 4 : 8; }

  /// Fills `numbers`, kRayNumbers for each row, with rows that follow each other from `data` on,
  /// which need not be aligned. T is that of RayType(). Rows are not checked.
  void Read(const char* data, std::span<float> numbers) const;
  void Read(const char* data, std::span<double> numbers) const;
  /// The same for a row whose numbers lie `stride` bytes from each other.
  void ReadColumns(const char* data, std::size_t stride, std::span<float, kRayNumbers> ray) const;
  void ReadColumns(const char* data, std::size_t stride, std::span<double, kRayNumbers> ray) const;
};

}  // namespace kdray::api
