// SPDX-License-Identifier: Apache-2.0
// A decoded batch of rays: from a .npy array, which is read where it lies, or from numbers in
// memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "api/npy.h"
#include "api/types.h"

namespace kdray::api {

/// The numbers of a ray, as RayTable gives them: ox oy oz t_min dx dy dz t_max.
inline constexpr std::size_t kRayNumbers = 8;

/// Immutable, so safe from many threads at once.
class RayTable {
 public:
  /// A batch of no rays.
  RayTable() = default;
  /// Rows in memory, kRayNumbers numbers each; the leading shape is (`rows`).
  RayTable(std::unique_ptr<double[]> numbers, std::size_t rows);

  /// Rays of an array of shape (…, 6) or (…, 8). Rows of 6 get `t_min` and `t_max`. Rows are
  /// numbered in C order of the leading shape, also for a Fortran array. invalid_array for another
  /// last dimension, too_many_rays. The array's data must outlive the table. O(1).
  static Outcome<RayTable> FromNpy(NpyArray array, double t_min, double t_max,
                                   std::uint64_t max_rows);

  /// The request's leading shape; its product is size().
  const std::vector<std::size_t>& shape() const { return shape_; }
  std::size_t size() const { return rows_; }
  /// The request's number type, which is the default `dtype` of the answer.
  NumberType number_type() const { return number_type_; }
  /// The type in which rows are read: that of the request. But if a float cannot hold the t_min or
  /// t_max of rows of 6, it is f8, because the interval must not change.
  NumberType row_type() const { return row_type_; }

  /// Fills `numbers` with the rows from `first_row` on, kRayNumbers numbers each; as many rows as
  /// fit, which must exist. T is that of row_type(). Rows are not checked.
  void Read(std::size_t first_row, std::span<float> numbers) const;
  void Read(std::size_t first_row, std::span<double> numbers) const;

  /// The memory of the first `rows` rows: of the array that the table reads, or its own. Who will
  /// not read them again may release it. Empty for a Fortran array, whose rows are not in order.
  std::span<const char> MemoryOf(std::size_t rows) const;

 private:
  struct NpyRows {
    NpyArray array;
    double t_min, t_max;
  };
  template <class Sent, class T>
  void ReadNpy(const NpyRows& npy, std::size_t first_row, std::span<T> numbers) const;

  std::vector<std::size_t> shape_ = {0};
  std::size_t rows_ = 0;
  NumberType number_type_ = NumberType::kF8, row_type_ = NumberType::kF8;
  std::variant<std::unique_ptr<double[]>, NpyRows> source_;
};

}  // namespace kdray::api
