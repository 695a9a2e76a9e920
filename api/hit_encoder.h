// SPDX-License-Identifier: Apache-2.0
// Rows of answers in their two forms, each kind of query with its own encoder.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "api/row_sink.h"
#include "api/types.h"

namespace kdray::api {

/// Immutable, so safe from many threads at once.
template <class Rows>
class RowEncoder {
 public:
  virtual ~RowEncoder() = default;

  // ---- npy ----
  /// The type of an element as a Python literal: `'<f4'` with its quotes, or a list.
  virtual std::string Descr() const = 0;
  /// The dimensions of an element: none, or that of a vector.
  virtual std::vector<std::size_t> ElementShape() const { return {}; }
  virtual std::size_t ElementBytes() const = 0;
  /// Writes the elements of the rows.
  virtual void PutNpy(const Rows& rows, char* out) const = 0;

  // ---- JSON ----
  /// No shorter than the text of the rows.
  virtual std::size_t MostJsonBytes(const Rows& rows) const = 0;
  /// Writes the rows, with a comma before each except the batch's first. Returns the end.
  virtual char* PutJson(const Rows& rows, char* out) const = 0;
};

/// `numbers` is the type of all numbers: in JSON, their text is the shortest that reads back as
/// that type. A hit's numbers are finite: a number beyond the type's range becomes its largest
/// finite number, so a hit never looks like a miss. No number is -0.
std::unique_ptr<RowEncoder<ClosestRows>> EncoderOfClosest(std::vector<RayField> fields,
                                                          NumberType numbers);
/// The elements of the array are hits, with the column `ray` in front.
std::unique_ptr<RowEncoder<AllRows>> EncoderOfAll(std::vector<RayField> fields, NumberType numbers);
std::unique_ptr<RowEncoder<AnyRows>> EncoderOfAny();
std::unique_ptr<RowEncoder<CountRows>> EncoderOfCount(NumberType numbers);

}  // namespace kdray::api
