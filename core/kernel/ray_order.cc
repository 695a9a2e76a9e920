#include "core/kernel/ray_order.h"

#include <algorithm>
#include <array>
#include <cmath>

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

void OrderRays(const RayBatch& rays, const Bounds3d& bounds, bool by_direction, std::size_t first,
               std::span<std::uint32_t> out) {
  const Grid grid(bounds, by_direction ? 4 : 5);
  std::array<unsigned, 32> spread;
  for (unsigned v = 0; v < 32; ++v) spread[v] = Spread(v);

  struct Entry {
    std::uint32_t key, row;
  };
  std::vector<Entry> entries(out.size()), moved(out.size());
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const Ray ray = rays[first + i];
    std::uint32_t key = spread[grid.Cell(ray.origin, 0)] | spread[grid.Cell(ray.origin, 1)] << 1 |
                        spread[grid.Cell(ray.origin, 2)] << 2;
    const unsigned octant = OctantOf(ray.direction);
    if (by_direction) {
      // Two bits for the steepness of each of the two smaller components.
      const double x = std::fabs(ray.direction.x), y = std::fabs(ray.direction.y),
                   z = std::fabs(ray.direction.z);
      const double sum = x + y + z;
      const auto two_bits = [&](double part) {
        return part >= 0.5 * sum ? 3u : part >= 0.3 * sum ? 2u : part >= 0.15 * sum ? 1u : 0u;
      };
      key = key << 7 | octant << 4 | two_bits(x) << 2 | two_bits(y);
    } else {
      key |= octant << 15;
    }
    entries[i] = {key, static_cast<std::uint32_t>(first + i)};
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
