// SPDX-License-Identifier: Apache-2.0
// The positions of samples in a pixel, and the directions of secondary rays.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/render/four.h"

namespace kdray::core {

/// A point of the unit square, in multiples of 2^-32.
struct SampleWords {
  std::uint32_t x = 0, y = 0;
  friend bool operator==(const SampleWords&, const SampleWords&) = default;
};

/// Samples 0, 1, 2, … of one pixel: a (0,2)-sequence moved by seed and pixel: among the first 2^k
/// samples, each box of area 2^-k with power-of-two sides contains exactly one. The sequence does
/// not depend on how many samples are taken (more can be added to a pixel that is still noisy), on
/// the region, or on any other pixel. All pixels share one Owen-scrambled sequence; each moves it
/// by exclusive or with two words of its own, which keeps the boxes and costs little. Sources:
/// Sobol' 1967; Owen, "Randomly Permuted (t,m,s)-Nets and (t,s)-Sequences", 1995; Laine and Karras,
/// "Stratified Sampling for Stochastic Transparency", EGSR 2011; Kollig and Keller, "Efficient
/// Multidimensional Sampling", 2002; Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4),
/// 2020.
class PixelSampler {
 public:
  PixelSampler(std::uint64_t seed, int x, int y);

  /// The position in the pixel.
  SampleWords operator[](std::uint32_t index) const {
    const SampleWords base = index < kStored ? kStoredBases[index] : Base(index);
    return {base.x ^ move_.x, base.y ^ move_.y};
  }
  /// The positions `index` and `index + 1`: x, y, x, y. `index` is even.
  FourWords Two(std::uint32_t index) const {
    const FourWords move = {move_.x, move_.y, move_.x, move_.y};
    FourWords base;
    if (index < kStored) [[likely]] {
      __builtin_memcpy(&base, &kStoredBases[index], sizeof(base));
      return base ^ move;
    }
    const SampleWords first = Base(index), second = Base(index + 1);
    base = FourWords{first.x, first.y, second.x, second.y};
    return base ^ move;
  }
  /// A point for the direction of the sample's secondary ray, independent of its position: the
  /// sequence of another order (within each power of two) and another move.
  SampleWords Direction(std::uint32_t index) const;

 private:
  static constexpr std::size_t kStored = 1024;
  static SampleWords Base(std::uint32_t index);
  static const std::array<SampleWords, kStored> kStoredBases;

  SampleWords move_;
  std::uint64_t pixel_;  // a hash of it
};

/// A hash of a 64-bit word: every input bit affects every output bit. Source: Steele, Lea, Flood,
/// "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014.
constexpr std::uint64_t MixBits(std::uint64_t word) {
  word += 0x9e3779b97f4a7c15u;
  word = (word ^ (word >> 30)) * 0xbf58476d1ce4e5b9u;
  word = (word ^ (word >> 27)) * 0x94d049bb133111ebu;
  return word ^ (word >> 31);
}

}  // namespace kdray::core
