// SPDX-License-Identifier: Apache-2.0
#include "core/proximity/point_batch.h"

#include <algorithm>
#include <array>

namespace kdray::core {
namespace {

constexpr unsigned kCellBits = 7;
constexpr unsigned kCells = 1u << kCellBits;
constexpr unsigned kRadixBits = 11;  // two passes sort the 21 bits of a key

// Bits 0 .. kCellBits - 1 of v at every third place.
constexpr unsigned Spread(unsigned v) {
  unsigned spread = 0;
  for (unsigned bit = 0; bit < kCellBits; ++bit) spread |= (v >> bit & 1u) << (3 * bit);
  return spread;
}
constexpr auto kSpread = [] {
  std::array<std::uint32_t, kCells> spread{};
  for (unsigned v = 0; v < kCells; ++v) spread[v] = Spread(v);
  return spread;
}();

}  // namespace

void OrderPoints(std::span<const Vec3d> points, const Bounds3d& bounds, std::size_t first,
                 std::span<std::uint32_t> out) {
  const Vec3d extent = bounds.Extent();
  Vec3d low, scale;
  for (int axis = 0; axis < 3; ++axis) {
    low[axis] = bounds.min[axis] - 0.5 * extent[axis];
    scale[axis] = extent[axis] > 0 ? kCells / (2 * extent[axis]) : 0;
  }
  const auto cell = [&](const Vec3d& p, int axis) {
    const double at = (p[axis] - low[axis]) * scale[axis];
    if (!(at > 0)) return 0u;  // also NaN
    return at < kCells - 1 ? static_cast<unsigned>(at) : kCells - 1;
  };
  struct Entry {
    std::uint32_t key, row;
  };
  std::vector<Entry> entries(out.size()), moved(out.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Vec3d& p = points[first + i];
    entries[i] = {kSpread[cell(p, 0)] | kSpread[cell(p, 1)] << 1 | kSpread[cell(p, 2)] << 2,
                  static_cast<std::uint32_t>(first + i)};
  }
  for (const unsigned shift : {0u, kRadixBits}) {
    std::array<std::uint32_t, 1u << kRadixBits> place{};
    constexpr std::uint32_t kMask = (1u << kRadixBits) - 1;
    for (const Entry& e : entries) ++place[e.key >> shift & kMask];
    std::uint32_t sum = 0;
    for (std::uint32_t& p : place) {
      const std::uint32_t count = p;
      p = sum;
      sum += count;
    }
    for (const Entry& e : entries) moved[place[e.key >> shift & kMask]++] = e;
    entries.swap(moved);
  }
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = entries[i].row;
}

}  // namespace kdray::core
