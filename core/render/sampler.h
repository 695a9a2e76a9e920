// The positions of samples in a pixel.
#pragma once

#include <cstdint>

namespace kdray::core {

struct SamplePosition {
  double x = 0, y = 0;  ///< in [0, 1), from the pixel's left and top
};

/// Samples 0, 1, 2, … of one pixel: a (0,2)-sequence scrambled by seed and pixel: among the first
/// 2^k samples, each box of area 2^-k with power-of-two sides contains exactly one. The sequence
/// does not depend on how many samples are taken (more can be added to a pixel that is still
/// noisy), on the region, or on any other pixel. Sources: Sobol' 1967; Owen, "Randomly Permuted
/// (t,m,s)-Nets and (t,s)-Sequences", 1995; Laine and Karras, "Stratified Sampling for Stochastic
/// Transparency", EGSR 2011; Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020.
class PixelSampler {
 public:
  PixelSampler(std::uint64_t seed, int x, int y);
  SamplePosition operator[](std::uint32_t index) const;

 private:
  std::uint32_t scramble_x_, scramble_y_;
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
