// SPDX-License-Identifier: Apache-2.0
// A set of triangles that is emptied for each ray: which ones were offered before.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/geometry/hit.h"

namespace kdray::core {

/// A hash table that grows with the triangles in it, and a bitmap once that is smaller. So its
/// memory is at most a bit for each triangle of the mesh, but at least 256 bytes.
class TriangleSet {
 public:
  /// Empties the set. `triangle_count` bounds the ids that follow. O(1).
  void Clear(std::size_t triangle_count);
  /// Whether the triangle was not in the set before.
  bool Insert(PrimitiveId id);
  bool Contains(PrimitiveId id) const;

 private:
  static constexpr std::size_t kFirstWords = 64;
  static constexpr std::size_t kWordBits = 32;

  bool is_bitmap() const { return size_ == kBitmap; }
  /// The word of the table that has `id`, or that may take it.
  std::size_t Find(PrimitiveId id) const;
  void Grow();
  void Prepare(std::size_t words);

  static constexpr std::size_t kBitmap = static_cast<std::size_t>(-1);
  std::vector<std::uint32_t> words_;    // of the table, or the bitmap; more after larger sets
  std::vector<std::uint32_t> scratch_;  // the table before
  std::size_t capacity_ = 0;            // the words in use
  std::size_t bitmap_words_ = 0;        // of a bitmap of all triangles
  std::size_t size_ = 0;                // triangles in the table, or kBitmap
};

}  // namespace kdray::core
