// SPDX-License-Identifier: Apache-2.0
#include "tests/support/image.h"

#include <png.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "tests/support/mesh_files.h"

namespace kdray::test {
namespace {

namespace fs = std::filesystem;

std::vector<std::byte> EncodePngForPeople(const Image& image) {
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  header.width = static_cast<png_uint_32>(image.width);
  header.height = static_cast<png_uint_32>(image.height);
  header.format = image.channels == 4 ? PNG_FORMAT_RGBA : PNG_FORMAT_RGB;
  png_alloc_size_t size = 0;
  if (png_image_write_to_memory(&header, nullptr, &size, 0, image.pixels.data(), 0, nullptr) == 0) {
    throw std::runtime_error("cannot encode a picture");
  }
  std::vector<std::byte> bytes(size);
  if (png_image_write_to_memory(&header, bytes.data(), &size, 0, image.pixels.data(), 0, nullptr) ==
      0) {
    throw std::runtime_error("cannot encode a picture");
  }
  bytes.resize(size);
  return bytes;
}

void WriteBytes(const fs::path& path, std::span<const std::byte> bytes) {
  fs::create_directories(path.parent_path());
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  if (!file) throw std::runtime_error("cannot write " + path.string());
}

int Difference(std::uint8_t a, std::uint8_t b) { return a < b ? b - a : a - b; }

}  // namespace

Image DecodePng(std::span<const std::byte> png) {
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_memory(&header, png.data(), png.size()) == 0) {
    throw std::runtime_error(std::string("not a PNG: ") + header.message);
  }
  Image image;
  image.width = static_cast<int>(header.width);
  image.height = static_cast<int>(header.height);
  image.channels = (header.format & PNG_FORMAT_FLAG_ALPHA) != 0 ? 4 : 3;
  header.format = image.channels == 4 ? PNG_FORMAT_RGBA : PNG_FORMAT_RGB;
  image.pixels.resize(PNG_IMAGE_SIZE(header));
  if (png_image_finish_read(&header, nullptr, image.pixels.data(), 0, nullptr) == 0) {
    throw std::runtime_error(std::string("broken PNG: ") + header.message);
  }
  return image;
}

testing::AssertionResult MatchesGolden(std::string_view name, std::span<const std::byte> png,
                                       const GoldenTolerance& tolerance) {
  const std::string stem(name);
  const fs::path golden_path = fs::path(KDRAY_SOURCE_DIR) / "tests/golden" / (stem + ".png");
  if (const char* update = std::getenv("KDRAY_UPDATE_GOLDEN"); update && *update == '1') {
    WriteBytes(golden_path, png);
    return testing::AssertionSuccess() << golden_path << " written";
  }
  const fs::path actual_path = fs::path(KDRAY_BINARY_DIR) / "golden" / (stem + ".actual.png");
  const fs::path difference_path =
      fs::path(KDRAY_BINARY_DIR) / "golden" / (stem + ".difference.png");
  const auto failure = [&] {
    WriteBytes(actual_path, png);
    return testing::AssertionFailure() << "golden " << golden_path << ", actual " << actual_path;
  };

  if (!fs::exists(golden_path)) {
    return failure() << ": there is no golden picture; look at the actual one, then run with "
                        "KDRAY_UPDATE_GOLDEN=1";
  }
  const Image golden = DecodePng(ReadFileBytes(golden_path));
  const Image actual = DecodePng(png);
  if (golden.width != actual.width || golden.height != actual.height ||
      golden.channels != actual.channels) {
    return failure() << ": other size or channels";
  }
  Image difference = {golden.width, golden.height, 3, {}};
  std::size_t differing = 0;
  int largest = 0;
  const auto channels = static_cast<std::size_t>(golden.channels);
  for (std::size_t i = 0; i < golden.pixels.size(); i += channels) {
    int pixel_difference = 0;
    for (std::size_t c = 0; c < channels; ++c) {
      const int d = Difference(golden.pixels[i + c], actual.pixels[i + c]);
      pixel_difference = std::max(pixel_difference, d);
      if (c < 3) difference.pixels.push_back(static_cast<std::uint8_t>(std::min(255, 8 * d)));
    }
    largest = std::max(largest, pixel_difference);
    if (pixel_difference > tolerance.code) ++differing;
  }
  const double share = static_cast<double>(differing) * static_cast<double>(channels) /
                       static_cast<double>(golden.pixels.size());
  if (share <= tolerance.pixel_share) return testing::AssertionSuccess();
  WriteBytes(difference_path, EncodePngForPeople(difference));
  return failure() << ", difference " << difference_path << ": " << differing
                   << " pixels differ by more than " << tolerance.code << " codes (largest "
                   << largest << "), a share of " << share << "; allowed " << tolerance.pixel_share;
}

}  // namespace kdray::test
