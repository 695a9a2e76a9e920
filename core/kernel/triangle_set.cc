// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/triangle_set.h"

#include <algorithm>

namespace kdray::core {

void TriangleSet::Clear(std::size_t triangle_count) {
  bitmap_words_ = (triangle_count + kWordBits - 1) / kWordBits;
  Prepare(std::min(kFirstWords, std::max<std::size_t>(bitmap_words_, 1)));
}

// Sets the words in use to an empty table, or an empty bitmap where that is as small.
void TriangleSet::Prepare(std::size_t words) {
  const bool bitmap = words >= bitmap_words_;
  capacity_ = bitmap ? std::max<std::size_t>(bitmap_words_, 1) : words;
  size_ = bitmap ? kBitmap : 0;
  if (words_.size() < capacity_) words_.resize(capacity_);
  std::fill_n(words_.begin(), capacity_, bitmap ? 0u : kNoPrimitive);
}

std::size_t TriangleSet::Find(PrimitiveId id) const {
  // Fibonacci hashing (Knuth, "The Art of Computer Programming", 6.4). The capacity is a power of
  // two, and half of it is free.
  std::size_t at = (id * std::uint64_t{0x9e3779b97f4a7c15} >> 32) & (capacity_ - 1);
  while (words_[at] != kNoPrimitive && words_[at] != id) at = (at + 1) & (capacity_ - 1);
  return at;
}

bool TriangleSet::Insert(PrimitiveId id) {
  if (is_bitmap()) {
    std::uint32_t& word = words_[id / kWordBits];
    const std::uint32_t bit = 1u << id % kWordBits;
    const bool is_new = (word & bit) == 0;
    word |= bit;
    return is_new;
  }
  const std::size_t at = Find(id);
  if (words_[at] == id) return false;
  words_[at] = id;
  if (2 * ++size_ > capacity_) Grow();
  return true;
}

bool TriangleSet::Contains(PrimitiveId id) const {
  if (is_bitmap()) return (words_[id / kWordBits] >> id % kWordBits & 1u) != 0;
  return words_[Find(id)] == id;
}

void TriangleSet::Grow() {
  scratch_.assign(words_.begin(), words_.begin() + static_cast<std::ptrdiff_t>(capacity_));
  Prepare(4 * capacity_);
  for (const PrimitiveId id : scratch_) {
    if (id != kNoPrimitive) Insert(id);
  }
}

}  // namespace kdray::core
