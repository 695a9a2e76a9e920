// SPDX-License-Identifier: Apache-2.0
#include "core/render/film.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <vector>

#include "core/render/color.h"
#include "core/render/sampler.h"

namespace kdray::core {
namespace {

TEST(Film, IsRowMajorWithTheTopRowFirst) {
  Film<float> film({10, 20, 13, 22}, 2);
  film(10, 20)[0] = 1;
  film(12, 20)[1] = 2;
  film(10, 21)[0] = 3;
  const std::vector<float> expected = {1, 0, 0, 0, 0, 2, 3, 0, 0, 0, 0, 0};
  EXPECT_EQ(std::vector<float>(film.values().begin(), film.values().end()), expected);
}

TEST(Film, IsCutIntoTilesThatCoverEachPixelOnce) {
  const Region region = {3, 5, 103, 72};
  for (const int side : {1, 7, 32, 64, 500}) {
    Film<int> counts(region, 1);
    const TileGrid tiles(region, side);
    for (std::size_t t = 0; t < tiles.size(); ++t) {
      const Tile tile = tiles[t];
      EXPECT_LE(tile.width(), side);
      EXPECT_LE(tile.height(), side);
      for (int y = tile.y0; y < tile.y1; ++y) {
        for (int x = tile.x0; x < tile.x1; ++x) ++counts(x, y)[0];
      }
    }
    for (const int count : counts.values()) ASSERT_EQ(count, 1);
  }
}

TEST(Color, SrgbHasTheValuesOfItsStandard) {
  EXPECT_EQ(SrgbToLinear(0.0f), 0.0f);
  EXPECT_EQ(SrgbToLinear(1.0f), 1.0f);
  EXPECT_NEAR(SrgbToLinear(0.5f), 0.21404114f, 1e-7f);
  EXPECT_NEAR(SrgbToLinear(0.04f), 0.04f / 12.92f, 1e-9f);
}

TEST(Color, EncodingRoundsToTheNearestCode) {
  // The forward curve, in double, independent of the table.
  const auto encode = [](double linear) {
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
  };
  for (int i = 0; i <= 200000; ++i) {
    const double linear = i / 200000.0;
    const double code = 255 * encode(linear);
    // Half a code, and a little for the float argument.
    ASSERT_NEAR(LinearToSrgb8(static_cast<float>(linear)), code, 0.5 + 1e-3) << linear;
  }
}

TEST(Color, EncodingGrowsWithTheValueAndTakesEveryCode) {
  // Every 64th float, where a code begins with its neighbours.
  std::uint8_t last = 0;
  for (std::uint32_t bits = 0; bits <= std::bit_cast<std::uint32_t>(1.0f); bits += 64) {
    const std::uint8_t code = LinearToSrgb8(std::bit_cast<float>(bits));
    ASSERT_LE(code - last, 1) << bits;
    ASSERT_GE(code, last) << bits;
    if (code != last) {
      std::uint8_t before = last;
      for (std::uint32_t near = bits - 63; near <= bits; ++near) {
        const std::uint8_t between = LinearToSrgb8(std::bit_cast<float>(near));
        ASSERT_GE(between, before) << near;
        before = between;
      }
    }
    last = code;
  }
  EXPECT_EQ(last, 255);
}

TEST(Color, EncodingKeepsEveryCode) {
  for (int code = 0; code < 256; ++code) {
    EXPECT_EQ(LinearToSrgb8(SrgbToLinear(static_cast<float>(code) / 255.0f)), code);
  }
}

TEST(Color, EncodingClampsWhatIsOutsideAndTakesNanForBlack) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  for (const float low : {-1.0f, -kInf, kNan, -0.0f}) {
    EXPECT_EQ(LinearToSrgb8(low), 0);
    EXPECT_EQ(ToUnorm8(low), 0);
  }
  for (const float high : {1.0f, 2.0f, kInf}) {
    EXPECT_EQ(LinearToSrgb8(high), 255);
    EXPECT_EQ(ToUnorm8(high), 255);
  }
  EXPECT_EQ(ToUnorm8(0.5f), 128);
}

TEST(Color, OverIsAssociative) {
  const Rgba a = {0.1f, 0.2f, 0.0f, 0.5f};
  const Rgba b = {0.3f, 0.1f, 0.2f, 0.25f};
  const Rgba c = {0.2f, 0.4f, 0.6f, 1.0f};
  const Rgba left = Over(Over(a, b), c);
  const Rgba right = Over(a, Over(b, c));
  EXPECT_NEAR(left.r, right.r, 1e-6f);
  EXPECT_NEAR(left.g, right.g, 1e-6f);
  EXPECT_NEAR(left.b, right.b, 1e-6f);
  EXPECT_NEAR(left.a, right.a, 1e-6f);
}

TEST(PixelSampler, StratifiesEveryPowerOfTwo) {
  for (const std::uint64_t seed : {0u, 1u, 77u}) {
    const PixelSampler sampler(seed, 12, 345);
    for (int k = 0; k <= 12; ++k) {
      // 2^k samples: each of the 2^k boxes of width 2^-i and height 2^-(k-i) holds exactly one.
      for (const int which : {0, 1}) {
        for (int i = 0; i <= k; ++i) {
          std::set<std::pair<int, int>> boxes;
          for (std::uint32_t n = 0; n < 1u << k; ++n) {
            const SampleWords at = which == 0 ? sampler[n] : sampler.Direction(n);
            boxes.emplace(static_cast<int>(std::ldexp(at.x, i - 32)),
                          static_cast<int>(std::ldexp(at.y, k - i - 32)));
          }
          ASSERT_EQ(boxes.size(), std::size_t{1} << k);
        }
      }
    }
  }
}

TEST(PixelSampler, DiffersBetweenPixelsAndSeedsOnly) {
  std::set<std::uint32_t> firsts;
  for (const std::uint64_t seed : {0u, 1u, 2u}) {
    for (int y = 0; y < 50; ++y) {
      for (int x = 0; x < 50; ++x) {
        EXPECT_EQ((PixelSampler(seed, x, y)[3].x), (PixelSampler(seed, x, y)[3].x));
        firsts.insert(PixelSampler(seed, x, y)[0].x);
      }
    }
  }
  EXPECT_GT(firsts.size(), 7490u);  // of 7500; 32-bit words coincide now and then
}

TEST(PixelSampler, HasItsMiddleInTheMiddleOfThePixel) {
  double sum_x = 0;
  double sum_y = 0;
  constexpr int kPixels = 10000;
  for (int x = 0; x < kPixels; ++x) {
    const SampleWords at = PixelSampler(5, x, 9)[0];
    sum_x += std::ldexp(at.x, -32);
    sum_y += std::ldexp(at.y, -32);
  }
  // Five standard errors of a uniform distribution.
  const double bound = 5 * std::sqrt(1.0 / 12 / kPixels);
  EXPECT_NEAR(sum_x / kPixels, 0.5, bound);
  EXPECT_NEAR(sum_y / kPixels, 0.5, bound);
}

}  // namespace
}  // namespace kdray::core
