// SPDX-License-Identifier: Apache-2.0
// A decoded batch of rays: from a .npy array, which is read where it lies; from numbers in memory;
// or from blocks of rays that were decoded while the array arrived.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "api/byte_block.h"
#include "api/npy.h"
#include "api/ray_rows.h"
#include "api/types.h"

namespace kdray::api {

/// Rays in memory, in the order of their rows: all blocks but the last have `rows_in_block`.
struct RayBlocks {
  NumberType sent = NumberType::kF4;  ///< and of the numbers in the blocks
  std::size_t rows = 0, rows_in_block = 1;
  std::vector<ByteBlock> blocks;
  std::vector<std::uint64_t> invalid;  ///< the numbers of invalid rows, ascending
};

/// Its const methods are safe from many threads at once.
class RayTable {
 public:
  /// A batch of no rays.
  RayTable() = default;
  /// Rows in memory, kRayNumbers numbers each; the leading shape is (`rows`).
  RayTable(std::unique_ptr<double[]> numbers, std::size_t rows);
  /// `shape` is the leading shape, whose product is the number of rows.
  RayTable(std::vector<std::size_t> shape, RayBlocks blocks);

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
  /// The type in which rows are read (RayRowForm::RayType()).
  NumberType row_type() const { return row_type_; }

  /// Fills `numbers` with the rows from `first_row` on, kRayNumbers numbers each; as many rows as
  /// fit, which must exist. T is that of row_type(). Rows are not checked.
  void Read(std::size_t first_row, std::span<float> numbers) const;
  void Read(std::size_t first_row, std::span<double> numbers) const;

  /// The blocks that the rays lie in, as they may be traced; null if rows must be Read().
  const RayBlocks* blocks() const { return std::get_if<RayBlocks>(&source_); }
  /// In blocks(): the numbers of the rays from `first_row`, which must exist, to the end of its
  /// block.
  std::span<const char> InBlock(std::size_t first_row) const;

  /// The memory of the first `rows` rows: of the array that the table reads, or its own. Who will
  /// not read them again may release it. Empty for a Fortran array, whose rows are not in order,
  /// and for blocks.
  std::span<const char> MemoryOf(std::size_t rows) const;
  /// Frees the blocks that have only rows before `rows`; these must not be read again. Returns the
  /// bytes that were freed.
  std::size_t FreeBlocks(std::size_t rows);

 private:
  struct NpyRows {
    NpyArray array;
    RayRowForm form;
  };
  template <class T>
  void ReadNpy(const NpyRows& npy, std::size_t first_row, std::span<T> numbers) const;
  void ReadBlocks(std::size_t first_row, std::span<char> out) const;

  std::vector<std::size_t> shape_ = {0};
  std::size_t rows_ = 0;
  NumberType number_type_ = NumberType::kF8, row_type_ = NumberType::kF8;
  std::variant<std::unique_ptr<double[]>, NpyRows, RayBlocks> source_;
};

}  // namespace kdray::api
