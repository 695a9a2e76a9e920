// SPDX-License-Identifier: Apache-2.0
// The pixel filter: how much the light around a pixel's centre counts for the pixel.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/render/four.h"

namespace kdray::core {

/// The Blackman-Harris window with a radius of 1.5 pixels, in x times in y. It is sampled by
/// importance: positions have its density, so all samples count the same and a pixel is the mean of
/// its own samples. So no pixel needs its neighbours' samples, and regions of an image join.
/// Sources: Harris, "On the Use of Windows for Harmonic Analysis with the Discrete Fourier
/// Transform", Proceedings of the IEEE 66(1), 1978 (4 terms, -92 dB); Ernst, Stamminger, Greiner,
/// "Filter Importance Sampling", 2006; Pharr, Jakob, Humphreys, "Physically Based Rendering", 4th
/// ed., 8.8.
class PixelFilter {
 public:
  static constexpr double kRadiusPx = 1.5;

  /// The one filter; made at the first call. Immutable, so safe from many threads at once.
  static const PixelFilter& Get();

  /// The distance from the pixel's centre along one axis below which the share word * 2^-32 of the
  /// filter lies; in [-kRadiusPx, kRadiusPx], monotonic in `word`. Within 2^-10 of a share, linear.
  float Offset(std::uint32_t word) const {
    const std::size_t piece = word >> kPieceBits;
    const float part = static_cast<float>(word & kPieceMask) * kPieceScale;
    return pieces_[piece].begin + part * pieces_[piece].length;
  }

  /// The offsets of four words.
  FourFloats Offsets(FourWords words) const {
    const FourFloats part =
        __builtin_convertvector(FourInts(words & kPieceMask), FourFloats) * kPieceScale;
    const FourWords piece = words >> kPieceBits;
    // A piece's two numbers are loaded as one of eight bytes.
    const auto two = [&](std::uint32_t first, std::uint32_t second) {
      double at[2];
      __builtin_memcpy(&at[0], &pieces_[first], sizeof(Piece));
      __builtin_memcpy(&at[1], &pieces_[second], sizeof(Piece));
      return FourFloats(TwoDoubles{at[0], at[1]});
    };
    const FourFloats low = two(piece[0], piece[1]);
    const FourFloats high = two(piece[2], piece[3]);
    return __builtin_shufflevector(low, high, 0, 2, 4, 6) +
           part * __builtin_shufflevector(low, high, 1, 3, 5, 7);
  }

  /// The share of the filter below `offset_px`: the inverse of Offset, without its pieces.
  static double ShareBelow(double offset_px);

 private:
  static constexpr std::size_t kPieces = 1024;  // of equal share
  static constexpr unsigned kPieceBits = 22;
  static constexpr std::uint32_t kPieceMask = (1u << kPieceBits) - 1;
  static constexpr float kPieceScale = 1.0f / (1u << kPieceBits);

  PixelFilter();

  struct Piece {
    float begin, length;
  };
  std::array<Piece, kPieces> pieces_;
};

}  // namespace kdray::core
