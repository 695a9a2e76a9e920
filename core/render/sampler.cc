#include "core/render/sampler.h"

namespace kdray::core {
namespace {

std::uint32_t ReverseBits(std::uint32_t word) {
  word = (word & 0x55555555u) << 1 | (word >> 1 & 0x55555555u);
  word = (word & 0x33333333u) << 2 | (word >> 2 & 0x33333333u);
  word = (word & 0x0f0f0f0fu) << 4 | (word >> 4 & 0x0f0f0f0fu);
  return __builtin_bswap32(word);
}

// Owen scrambling of a number with reversed bits: after multiplying by even constants, a bit
// depends only on lower bits, which the reversal makes the more significant ones.
std::uint32_t ScrambleReversed(std::uint32_t word, std::uint32_t seed) {
  word += seed;
  word ^= word * 0x6c50b47cu;
  word ^= word * 0xb82f1e52u;
  word ^= word * 0xc7afe638u;
  word ^= word * 0x8d22f6e6u;
  return word;
}

// Second dimension of Sobol's sequence: direction numbers of the polynomial x + 1.
std::uint32_t SobolSecond(std::uint32_t index) {
  std::uint32_t result = 0;
  for (std::uint32_t direction = 1u << 31; index != 0; index >>= 1, direction ^= direction >> 1) {
    if ((index & 1u) != 0) result ^= direction;
  }
  return result;
}

double ToUnitInterval(std::uint32_t word) { return static_cast<double>(word) * 0x1p-32; }

}  // namespace

PixelSampler::PixelSampler(std::uint64_t seed, int x, int y) {
  const std::uint64_t pixel = static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32 |
                              static_cast<std::uint32_t>(y);
  const std::uint64_t mixed = MixBits(MixBits(seed) ^ pixel);
  scramble_x_ = static_cast<std::uint32_t>(mixed);
  scramble_y_ = static_cast<std::uint32_t>(mixed >> 32);
}

SamplePosition PixelSampler::operator[](std::uint32_t index) const {
  // The first dimension is the index's reversed bits, so reversing it again gives the index.
  return {
      ToUnitInterval(ReverseBits(ScrambleReversed(index, scramble_x_))),
      ToUnitInterval(ReverseBits(ScrambleReversed(ReverseBits(SobolSecond(index)), scramble_y_)))};
}

}  // namespace kdray::core
