// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/ray_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>

#include "core/base/float4.h"
#include "core/base/parallel.h"

namespace kdray::core {

namespace {

constexpr unsigned kRadixBits = 10;

unsigned OctantOf(const Vec3d& d) {
  return static_cast<unsigned>(d.x < 0) | static_cast<unsigned>(d.y < 0) << 1 |
         static_cast<unsigned>(d.z < 0) << 2;
}

// Within some 11 degrees. False for invalid rays.
bool AreClose(const Vec3d& a, const Vec3d& b) { return Dot(a, b) > 0.98 * Length(a) * Length(b); }

// Cells of a grid over the bounds; points outside map to the nearest cell.
class Grid {
 public:
  Grid(const Bounds3d& bounds, unsigned bits) : min_(bounds.min), last_((1u << bits) - 1) {
    const Vec3d extent = bounds.Extent();
    for (int axis = 0; axis < 3; ++axis) {
      scale_[axis] = extent[axis] > 0 ? (last_ + 1) / extent[axis] : 0;
    }
  }
  unsigned Cell(const Vec3d& p, int axis) const {
    const double at = (p[axis] - min_[axis]) * scale_[axis];
    // Also false for NaN of invalid rays.
    if (!(at > 0)) return 0;
    return at < last_ ? static_cast<unsigned>(at) : last_;
  }

 private:
  Vec3d min_, scale_;
  unsigned last_;
};

// A sample position below `count`. Multiples of the golden ratio, because equal steps can fall on
// the ends of all rows of pixels.
std::size_t SampleOf(std::size_t number, std::size_t count) {
  const double at = static_cast<double>(number) * 0.6180339887498949;
  return static_cast<std::size_t>((at - std::floor(at)) * static_cast<double>(count));
}

unsigned Spread(unsigned v) {  // spreads bits 0..4 to every third bit
  unsigned spread = 0;
  for (unsigned bit = 0; bit < 5; ++bit) spread |= (v >> bit & 1u) << (3 * bit);
  return spread;
}

}  // namespace

bool IsShuffled(const RayBatch& rays, const Bounds3d& bounds) {
  constexpr std::size_t kSamples = 64;
  if (rays.size() < 2) return false;
  const Grid grid(bounds, 4);
  std::size_t alike = 0;
  for (std::size_t s = 0; s < kSamples; ++s) {
    const std::size_t i = SampleOf(s, rays.size() - 1);
    const Ray a = rays[i];
    const Ray b = rays[i + 1];
    // Directions are compared only for equal origins: from nearby origins even scattered rays share
    // nodes and triangles.
    bool near = !(a.origin == b.origin) || AreClose(a.direction, b.direction);
    for (int axis = 0; axis < 3; ++axis) {
      const unsigned p = grid.Cell(a.origin, axis);
      const unsigned q = grid.Cell(b.origin, axis);
      near = near && p <= q + 1 && q <= p + 1;
    }
    alike += near ? 1 : 0;
  }
  return 2 * alike < kSamples;
}

double CountGroups(const RayBatch& rays, const Bounds3d& bounds) {
  constexpr std::size_t kSamples = 512;
  const Grid grid(bounds, 4);
  std::array<std::uint32_t, kSamples> group;
  for (std::size_t s = 0; s < kSamples; ++s) {
    const Ray ray = rays[SampleOf(s, rays.size())];
    group[s] = OctantOf(ray.direction);
    for (int axis = 0; axis < 3; ++axis) group[s] = group[s] << 4 | grid.Cell(ray.origin, axis);
  }
  std::sort(group.begin(), group.end());
  std::size_t pairs = 0;
  std::size_t run = 0;
  for (std::size_t s = 1; s < kSamples; ++s) {
    run = group[s] == group[s - 1] ? run + 1 : 0;
    pairs += run;
  }
  constexpr double kPairs = 0.5 * kSamples * (kSamples - 1);
  return kPairs / static_cast<double>(pairs);
}

namespace {

struct Entry {
  std::uint32_t key, row;
};

// The keys of a batch's rays.
class Keys {
 public:
  Keys(const RayBatch& rays, const Bounds3d& bounds, bool by_direction)
      : rays_(rays), by_direction_(by_direction), grid_(bounds, by_direction ? 4 : 5) {
    for (unsigned v = 0; v < 32; ++v) spread_[v] = Spread(v);
    last_ = by_direction ? 15.0f : 31.0f;
    for (int axis = 0; axis < 3; ++axis) {
      min_[axis] = static_cast<float>(bounds.min[axis]);
      const double extent = bounds.Extent()[axis];
      scale_[axis] =
          extent > 0 ? static_cast<float>((static_cast<double>(last_) + 1) / extent) : 0.0f;
    }
  }

  // entries[i] is that of row first + i.
  void Fill(std::size_t first, std::span<Entry> entries) const {
    std::size_t i = 0;
    if (const RayF* floats = rays_.floats()) {
      for (; i + 4 <= entries.size(); i += 4) FillFour(floats + first + i, first + i, &entries[i]);
    }
    for (; i < entries.size(); ++i) {
      entries[i] = {KeyOf(rays_[first + i]), static_cast<std::uint32_t>(first + i)};
    }
  }

 private:
  std::uint32_t KeyOf(const Ray& ray) const {
    const std::uint32_t key = spread_[grid_.Cell(ray.origin, 0)] |
                              spread_[grid_.Cell(ray.origin, 1)] << 1 |
                              spread_[grid_.Cell(ray.origin, 2)] << 2;
    const unsigned octant = OctantOf(ray.direction);
    if (!by_direction_) return key | octant << 15;
    // Two bits for the steepness of each of the two smaller components.
    const double x = std::fabs(ray.direction.x), y = std::fabs(ray.direction.y),
                 z = std::fabs(ray.direction.z);
    const double sum = x + y + z;
    const auto two_bits = [&](double part) {
      return part >= 0.5 * sum ? 3u : part >= 0.3 * sum ? 2u : part >= 0.15 * sum ? 1u : 0u;
    };
    return key << 7 | octant << 4 | two_bits(x) << 2 | two_bits(y);
  }

  // The same of four rays at once; rounding may differ.
  void FillFour(const RayF* rays, std::size_t row, Entry* entries) const {
    Float4 from[4], to[4];  // of a ray, then of x, y, z and the interval's ends
    for (int k = 0; k < 4; ++k) {
      from[k] = Load4(&rays[k].origin);
      to[k] = Load4(&rays[k].direction);
    }
    Transpose(from);
    Transpose(to);
    Unsigned4 key = {}, octant = {};
    for (int axis = 0; axis < 3; ++axis) {
      const Float4 at = (from[axis] - Fill4(min_[axis])) * Fill4(scale_[axis]);
      // NaN of invalid rays becomes 0.
      const Float4 inside = Min4(Max4(at, Fill4(0)), Fill4(last_));
      key |= SpreadFour(Unsigned4(Truncate4(inside))) << static_cast<unsigned>(axis);
      octant |= Unsigned4(to[axis] < Fill4(0)) & (1u << axis);
    }
    if (by_direction_) {
      const auto size = [](Float4 v) { return Float4(Unsigned4(v) & 0x7fffffffu); };
      const Float4 x = size(to[0]), y = size(to[1]);
      const Float4 sum = x + y + size(to[2]);
      const auto two_bits = [&](Float4 part) {
        const Int4 steps = (part >= Fill4(0.5f) * sum) + (part >= Fill4(0.3f) * sum) +
                           (part >= Fill4(0.15f) * sum);
        return Unsigned4(-steps);
      };
      key = key << 7u | octant << 4u | two_bits(x) << 2u | two_bits(y);
    } else {
      key |= octant << 15u;
    }
    const auto number = static_cast<std::uint32_t>(row);
    const Unsigned4 rows = {number, number + 1, number + 2, number + 3};
    const Unsigned4 pairs[2] = {__builtin_shufflevector(key, rows, 0, 4, 1, 5),
                                __builtin_shufflevector(key, rows, 2, 6, 3, 7)};
    static_assert(sizeof(pairs) == 4 * sizeof(Entry));
    std::memcpy(static_cast<void*>(entries), pairs, sizeof(pairs));
  }

  static void Transpose(Float4 (&rows)[4]) {
    const Float4 low01 = __builtin_shufflevector(rows[0], rows[1], 0, 4, 1, 5);
    const Float4 low23 = __builtin_shufflevector(rows[2], rows[3], 0, 4, 1, 5);
    const Float4 high01 = __builtin_shufflevector(rows[0], rows[1], 2, 6, 3, 7);
    const Float4 high23 = __builtin_shufflevector(rows[2], rows[3], 2, 6, 3, 7);
    rows[0] = __builtin_shufflevector(low01, low23, 0, 1, 4, 5);
    rows[1] = __builtin_shufflevector(low01, low23, 2, 3, 6, 7);
    rows[2] = __builtin_shufflevector(high01, high23, 0, 1, 4, 5);
    rows[3] = __builtin_shufflevector(high01, high23, 2, 3, 6, 7);
  }
  // Spread, in each lane.
  static Unsigned4 SpreadFour(Unsigned4 v) {
    v = (v | v << 8u) & 0x100fu;
    v = (v | v << 4u) & 0x10c3u;
    return (v | v << 2u) & 0x1249u;
  }

  const RayBatch& rays_;
  const bool by_direction_;
  const Grid grid_;
  std::array<unsigned, 32> spread_;
  float last_, min_[3], scale_[3];
};

// The rays of a task.
constexpr std::size_t kPiece = std::size_t{1} << 14;

// One pass of a stable radix sort: place(entry, position) for each entry. Pieces are counted and
// placed in parallel.
template <class Place>
void SortByDigit(std::span<const Entry> entries, unsigned shift, const Place& place) {
  constexpr std::size_t kDigits = std::size_t{1} << kRadixBits;
  const auto digit_of = [&](const Entry& e) { return e.key >> shift & (kDigits - 1); };
  // Counts by piece and digit, then the first free positions.
  using Positions = std::array<std::uint32_t, kDigits>;
  std::vector<Positions> positions((entries.size() + kPiece - 1) / kPiece);
  ParallelFor(0, entries.size(), kPiece, [&](std::size_t first, std::size_t last) {
    Positions& counts = positions[first / kPiece];
    for (std::size_t i = first; i < last; ++i) ++counts[digit_of(entries[i])];
  });
  std::uint32_t sum = 0;
  for (std::size_t digit = 0; digit < kDigits; ++digit) {
    for (Positions& piece : positions) {
      const std::uint32_t count = piece[digit];
      piece[digit] = sum;
      sum += count;
    }
  }
  ParallelFor(0, entries.size(), kPiece, [&](std::size_t first, std::size_t last) {
    Positions& next = positions[first / kPiece];
    for (std::size_t i = first; i < last; ++i) place(entries[i], next[digit_of(entries[i])]++);
  });
}

}  // namespace

void OrderRays(const RayBatch& rays, const Bounds3d& bounds, bool by_direction, std::size_t first,
               std::span<std::uint32_t> out) {
  const Keys keys(rays, bounds, by_direction);
  // Not zeroed: that takes as long as making the keys.
  const auto entries = std::make_unique_for_overwrite<Entry[]>(out.size());
  const auto moved = std::make_unique_for_overwrite<Entry[]>(out.size());
  ParallelFor(0, out.size(), kPiece, [&](std::size_t from, std::size_t to) {
    keys.Fill(first + from, std::span(entries.get() + from, to - from));
  });
  SortByDigit(std::span<const Entry>(entries.get(), out.size()), 0,
              [&](const Entry& e, std::uint32_t at) { moved[at] = e; });
  SortByDigit(std::span<const Entry>(moved.get(), out.size()), kRadixBits,
              [&](const Entry& e, std::uint32_t at) { out[at] = e.row; });
}

}  // namespace kdray::core
