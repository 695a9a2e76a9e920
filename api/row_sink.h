// SPDX-License-Identifier: Apache-2.0
// The rows of a batch's answer on their way from the backend to whoever writes them
// (api/answer_writer.h).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "api/types.h"

namespace kdray::api {

/// Hits, one after the other, with their details: each list of details is empty unless its field is
/// requested; then it has one element per hit. NaN, side 0 and group -1 stand for a miss, and for
/// what the file does not have.
struct Hits {
  std::span<const RayHit> hits;
  std::span<const Vec3> normals, points;
  std::span<const std::int8_t> sides;
  std::span<const std::int32_t> groups = {};
  std::span<const std::array<double, 2>> uvs = {};
  std::span<const Vec3> shading_normals = {};

  std::size_t size() const { return hits.size(); }
};

// Consecutive rows of an answer, from the batch's row `first_row` on. An element is what an array
// has one of: a row, or for `all` a hit.

/// `closest`: one hit or miss per row.
struct ClosestRows {
  std::size_t first_row = 0;
  Hits hits;

  std::size_t size() const { return hits.size(); }
  std::size_t first_element() const { return first_row; }
};

/// `any`: 0 or 1 per row.
struct AnyRows {
  std::size_t first_row = 0;
  std::span<const std::uint8_t> occluded;

  std::size_t size() const { return occluded.size(); }
  std::size_t first_element() const { return first_row; }
};

/// `count`: a number per row.
struct CountRows {
  std::size_t first_row = 0;
  std::span<const std::uint32_t> counts;

  std::size_t size() const { return counts.size(); }
  std::size_t first_element() const { return first_row; }
};

/// `all`: the hits of the rows, row by row; row first_row + i has counts[i] of them. `first_hit`
/// hits are those of earlier rows.
struct AllRows {
  std::size_t first_row = 0, first_hit = 0;
  std::span<const std::uint32_t> counts;
  Hits hits;

  std::size_t size() const { return counts.size(); }
  std::size_t first_element() const { return first_hit; }
};

/// Takes an answer block by block: Begin() announces a block, then Put() brings its rows, each
/// once, in any order and from many threads at once.
template <class Rows>
class RowSink {
 public:
  virtual ~RowSink() = default;
  /// The next block has `elements` elements. The problem, if there is no memory for them.
  virtual Check Begin(std::size_t elements) = 0;
  virtual void Put(const Rows& rows) = 0;
  /// The batch's first `rows` rows have been read and will not be read again. Called between
  /// blocks.
  virtual void HaveRead(std::size_t rows) { (void)rows; }
};

}  // namespace kdray::api
