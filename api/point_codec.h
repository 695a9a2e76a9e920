// Decodes batches of points, and encodes their answers, as JSON or .npy.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "api/batch_type.h"
#include "api/limits.h"
#include "api/points.h"
#include "api/should_stop.h"
#include "api/types.h"

namespace kdray::api {

/// Reads `{"points": [[x, y, z],…]}` or a .npy array of shape (…, 3), whose rows are numbered in C
/// order of the leading shape, also for a Fortran array. invalid_json (with the JSON pointer, and
/// the line), invalid_array, too_many_rays beyond `limits.max_rays` rows, body_too_large. Rows are
/// not checked: the backend lists invalid ones. Memory: 24 bytes a row. When `should_stop` returns
/// true, any problem comes back.
Outcome<PointTable> DecodePoints(std::string_view body, BatchType type, const Limits& limits,
                                 const ShouldStop& should_stop = {});

/// The part of DecodePoints for .npy arrays.
Outcome<PointTable> PointsFromNpy(std::string_view body, std::uint64_t max_rows,
                                  const ShouldStop& should_stop = {});

/// Writes the answer of a point query while its rows arrive, in order. npy: the request's leading
/// shape; of `closest` one field is a plain array, several a packed structured one, numbers
/// `<f4`/`<i4` or `<f8`/`<i8`; `inside` is `|i1`. JSON: `null` for a row without an answer. No
/// number is -0; a finite number beyond the type is its largest one.
class PointWriter {
 public:
  PointWriter(const PointTable& points, const PointOptions& options, BatchType type);

  // One of these for all rows of an answer.
  void Put(std::span<const NearestPoint> rows);
  void Put(std::span<const double> signed_distances);
  /// 1, 0, or -1 for unknown.
  void Put(std::span<const std::int8_t> inside);

  std::size_t memory_bytes() const { return out_.capacity(); }

  /// The whole answer, after the last row.
  std::string Finish(const std::vector<std::uint64_t>& invalid) &&;

 private:
  void BeginNpy(std::string_view descr, std::size_t row_bytes, bool of_vectors);
  void BeginRow() {
    if (rows_++ != 0) out_ += ',';
  }
  template <class T>
  void PutAs(std::span<const NearestPoint> rows);

  const PointTable& points_;
  const PointOptions& options_;
  const BatchType type_;
  const NumberType numbers_;
  std::size_t rows_ = 0;  ///< written
  std::string out_;
};

}  // namespace kdray::api
