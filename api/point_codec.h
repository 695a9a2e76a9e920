// SPDX-License-Identifier: Apache-2.0
// Decodes batches of points, and encodes their answers, as JSON or .npy.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "api/batch_type.h"
#include "api/batch_work.h"
#include "api/byte_block.h"
#include "api/limits.h"
#include "api/points.h"
#include "api/types.h"

namespace kdray::api {

/// Reads `{"points": [[x, y, z],…]}` or a .npy array of shape (…, 3), whose rows are numbered in C
/// order of the leading shape, also for a Fortran array. invalid_json (with the JSON pointer, and
/// the line), invalid_array, too_many_rays beyond `limits.max_rays` rows, body_too_large. Rows are
/// not checked: the backend lists invalid ones. Memory: 24 bytes a row, charged before it is taken.
/// When `work.should_stop` returns true, any problem comes back.
Outcome<PointTable> DecodePoints(std::string_view body, BatchType type, const Limits& limits,
                                 const BatchWork& work = {});

/// The part of DecodePoints for .npy arrays.
Outcome<PointTable> PointsFromNpy(std::string_view body, std::uint64_t max_rows,
                                  const BatchWork& work = {});

/// The most rows that a JSON text can have: each ends with a bracket. Their memory is charged.
Outcome<std::size_t> MostJsonRows(std::string_view body, std::uint64_t max_rows,
                                  std::size_t row_bytes, const BatchWork& work);

/// Writes the answer of a point query while its rows arrive, in order; keeps it in pieces. npy: the
/// request's leading shape; of `closest` one field is a plain array, several a packed structured
/// one, numbers
/// `<f4`/`<i4` or `<f8`/`<i8`; `inside` is `|i1`. JSON: `null` for a row without an answer. No
/// number is -0; a finite number beyond the type is its largest one.
class PointWriter {
 public:
  PointWriter(const PointTable& points, const PointOptions& options, BatchType type,
              ChargeBytes charge = {});

  // One of these for all rows of an answer. The problem is that of `charge`.
  Check Put(std::span<const NearestPoint> rows);
  Check Put(std::span<const double> signed_distances);
  /// 1, 0, or -1 for unknown.
  Check Put(std::span<const std::int8_t> inside);

  /// The whole answer, in order, after the last row.
  Outcome<std::vector<ByteBlock>> Finish(const std::vector<std::uint64_t>& invalid) &&;

 private:
  Check EndPiece();
  void BeginNpy(std::string_view descr, bool of_vectors);
  void BeginRow() {
    if (rows_++ != 0) out_ += ',';
  }
  template <class T>
  void PutAs(std::span<const NearestPoint> rows);

  const PointTable& points_;
  const PointOptions& options_;
  const BatchType type_;
  const NumberType numbers_;
  const ChargeBytes charge_;
  bool is_npy_begun_ = false;
  std::size_t rows_ = 0;  ///< written
  std::string out_;       ///< the piece that is being written
  std::vector<ByteBlock> pieces_;
};

}  // namespace kdray::api
