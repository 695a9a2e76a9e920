// SPDX-License-Identifier: Apache-2.0
#include "core/io/png_writer.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <thread>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "tests/support/image.h"
#include "tests/support/seed.h"

namespace kdray::core {
namespace {

std::vector<std::uint8_t> RandomPixels(int width, int height, int channels) {
  std::mt19937_64 random = test::RandomEngine(201);
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(width * height * channels));
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    // Smooth above, noise below, so that both repeats and literals are written.
    pixels[i] = static_cast<std::uint8_t>(i < pixels.size() / 2 ? i / 64 : random());
  }
  return pixels;
}

TEST(PngWriter, WritesWhatAnotherLibraryReads) {
  for (const auto& [width, height] :
       {std::pair{1, 1}, {7, 3}, {640, 480}, {16384, 2}, {2, 16384}, {16384, 200}}) {
    for (const int channels : {3, 4}) {
      const std::vector<std::uint8_t> pixels = RandomPixels(width, height, channels);
      const Result<std::vector<std::byte>> png = EncodePng(pixels, width, height, channels);
      ASSERT_TRUE(png.ok()) << png.error().message;
      EXPECT_EQ(test::DecodePng(*png), (test::Image{width, height, channels, pixels}));
    }
  }
}

TEST(PngWriter, JoinsStripsOfRowsWithoutASeam) {
  // A strip has at most 2^22 / 1920 = 2184 rows.
  for (const int height : {2183, 2184, 2185, 4367, 4368, 4369, 6600}) {
    const std::vector<std::uint8_t> pixels = RandomPixels(640, height, 3);
    const Result<std::vector<std::byte>> png = EncodePng(pixels, 640, height, 3);
    ASSERT_TRUE(png.ok()) << png.error().message;
    EXPECT_EQ(test::DecodePng(*png), (test::Image{640, height, 3, pixels})) << height;
  }
  // Streams of every length, so that blocks end at every bit of a byte.
  for (int i = 0; i < 24; ++i) {
    std::vector<std::uint8_t> pixels(std::size_t{16384} * 65 * 4);
    std::mt19937_64 random(static_cast<std::uint64_t>(i));
    for (int k = 0; k < 20 * i; ++k) pixels[random() % pixels.size()] = 1;
    EXPECT_EQ(test::DecodePng(*EncodePng(pixels, 16384, 65, 4)).pixels, pixels) << i;
  }
}

TEST(PngWriter, GivesTheSameBytesOnAnyNumberOfThreads) {
  const std::vector<std::uint8_t> pixels = RandomPixels(640, 4000, 3);
  std::vector<std::byte> alone, together;
  Arena(1).Run([&] { alone = *EncodePng(pixels, 640, 4000, 3); });
  Arena(4).Run([&] { together = *EncodePng(pixels, 640, 4000, 3); });
  EXPECT_EQ(alone, together);
}

TEST(PngWriter, StopsWhenCancelled) {
  const std::vector<std::uint8_t> pixels = RandomPixels(640, 480, 3);
  const CancelToken cancel = CancelToken::Cancellable();
  cancel.Cancel();
  EXPECT_EQ(EncodePng(pixels, 640, 480, 3, cancel).error().code, ErrorCode::kCancelled);
}

TEST(PngWriter, WritesGreyAsGrey) {
  const std::vector<std::uint8_t> grey = {0, 100, 200, 255};
  const test::Image image = test::DecodePng(*EncodePng(grey, 2, 2, 1));
  EXPECT_EQ(image.pixels,
            (std::vector<std::uint8_t>{0, 0, 0, 100, 100, 100, 200, 200, 200, 255, 255, 255}));
  const std::vector<std::uint8_t> grey_alpha = {10, 20, 30, 40};
  EXPECT_EQ(test::DecodePng(*EncodePng(grey_alpha, 2, 1, 2)).pixels,
            (std::vector<std::uint8_t>{10, 10, 10, 20, 30, 30, 30, 40}));
}

TEST(PngWriter, RefusesSidesThatDoNotFit) {
  const std::vector<std::uint8_t> pixels(12);
  struct Case {
    int width, height, channels;
  };
  for (const Case& c : {Case{0, 1, 3},
                        {1, 0, 3},
                        {-1, 4, 3},
                        {16385, 1, 3},
                        {1, 16385, 3},
                        {2, 2, 0},
                        {2, 2, 5},
                        {2, 3, 3},
                        {1, 2, 3},
                        {16384, 16384, 4}}) {
    const Result<std::vector<std::byte>> png = EncodePng(pixels, c.width, c.height, c.channels);
    ASSERT_FALSE(png.ok()) << c.width << 'x' << c.height << 'x' << c.channels;
    EXPECT_EQ(png.error().code, ErrorCode::kInvalidArgument);
  }
}

TEST(PngWriter, GivesTheSameBytesFromManyThreads) {
  const std::vector<std::uint8_t> pixels = RandomPixels(200, 100, 3);
  const std::vector<std::byte> expected = *EncodePng(pixels, 200, 100, 3);
  std::vector<std::vector<std::byte>> results(4);
  {
    std::vector<std::jthread> threads;
    for (std::vector<std::byte>& result : results) {
      threads.emplace_back([&] { result = *EncodePng(pixels, 200, 100, 3); });
    }
  }
  for (const std::vector<std::byte>& result : results) EXPECT_EQ(result, expected);
}

}  // namespace
}  // namespace kdray::core
