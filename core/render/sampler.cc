// SPDX-License-Identifier: Apache-2.0
#include "core/render/sampler.h"

namespace kdray::core {
namespace {

constexpr std::uint32_t ReverseBits(std::uint32_t word) {
  word = (word & 0x55555555u) << 1 | (word >> 1 & 0x55555555u);
  word = (word & 0x33333333u) << 2 | (word >> 2 & 0x33333333u);
  word = (word & 0x0f0f0f0fu) << 4 | (word >> 4 & 0x0f0f0f0fu);
  return __builtin_bswap32(word);
}

// Owen scrambling of a number with reversed bits: after multiplying by even constants, a bit
// depends only on lower bits, which the reversal makes the more significant ones.
constexpr std::uint32_t ScrambleReversed(std::uint32_t word, std::uint32_t seed) {
  word += seed;
  word ^= word * 0x6c50b47cu;
  word ^= word * 0xb82f1e52u;
  word ^= word * 0xc7afe638u;
  word ^= word * 0x8d22f6e6u;
  return word;
}

// Second dimension of Sobol's sequence: direction numbers of the polynomial x + 1.
constexpr std::uint32_t SobolSecond(std::uint32_t index) {
  std::uint32_t result = 0;
  for (std::uint32_t direction = 1u << 31; index != 0; index >>= 1, direction ^= direction >> 1) {
    if ((index & 1u) != 0) result ^= direction;
  }
  return result;
}

// The common sequence. Its two seeds are arbitrary.
constexpr SampleWords ScrambledSobol(std::uint32_t index) {
  // The first dimension is the index's reversed bits, so reversing it again gives the index.
  return {ReverseBits(ScrambleReversed(index, 0x3c6ef372u)),
          ReverseBits(ScrambleReversed(ReverseBits(SobolSecond(index)), 0xa54ff53au))};
}

template <std::size_t kCount>
constexpr std::array<SampleWords, kCount> FirstPoints() {
  std::array<SampleWords, kCount> points{};
  for (std::uint32_t i = 0; i < kCount; ++i) points[i] = ScrambledSobol(i);
  return points;
}

constexpr SampleWords ToWords(std::uint64_t bits) {
  return {static_cast<std::uint32_t>(bits), static_cast<std::uint32_t>(bits >> 32)};
}

}  // namespace

constexpr std::array<SampleWords, PixelSampler::kStored> PixelSampler::kStoredBases =
    FirstPoints<kStored>();

SampleWords PixelSampler::Base(std::uint32_t index) { return ScrambledSobol(index); }

PixelSampler::PixelSampler(std::uint64_t seed, int x, int y) {
  const std::uint64_t pixel = static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32 |
                              static_cast<std::uint32_t>(y);
  pixel_ = MixBits(MixBits(seed) ^ pixel);
  move_ = ToWords(pixel_);
}

SampleWords PixelSampler::Direction(std::uint32_t index) const {
  const std::uint64_t other = MixBits(pixel_);
  const SampleWords move = ToWords(MixBits(other));
  // Within 1,024 indices in another order: a bit depends only on higher bits, so each aligned block
  // of 2^k indices stays one, and the first 2^k points still fill their boxes.
  constexpr std::uint32_t kMask = kStored - 1;
  const std::uint32_t order =
      ReverseBits(ScrambleReversed(ReverseBits(index & kMask), static_cast<std::uint32_t>(other)));
  const std::uint32_t shuffled = (index & ~kMask) | (order & kMask);
  const SampleWords base = index < kStored ? kStoredBases[shuffled] : Base(shuffled);
  return {base.x ^ move.x, base.y ^ move.y};
}

}  // namespace kdray::core
