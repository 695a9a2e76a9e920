// SPDX-License-Identifier: Apache-2.0
#include "core/io/meshopt_filters.h"

#include <gtest/gtest.h>
#include <meshoptimizer.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "tests/support/seed.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

// Elements that any bytes may be, except what the library does not define.
std::vector<std::int16_t> RandomShorts(std::size_t count) {
  std::mt19937_64 random(test::Seed() + 1);
  std::vector<std::int16_t> numbers(count);
  for (std::int16_t& number : numbers) number = static_cast<std::int16_t>(random());
  return numbers;
}

template <class T>
std::vector<T> Filtered(MeshoptFilter filter, std::uint64_t stride, std::vector<T> numbers) {
  CancelPoll poll{CancelToken()};
  EXPECT_TRUE(
      ApplyMeshoptFilter(filter, stride, std::as_writable_bytes(std::span(numbers)), &poll));
  return numbers;
}

TEST(MeshoptFilters, ReadUnitVectorsAsTheLibraryDoesWithinAUnit) {
  std::vector<float> normals;
  const MeshData sphere = test::IcoSphere({0, 0, 0}, 1, 3);
  for (const Vec3d& n : sphere.vertices) {
    for (const double c : {n.x, n.y, n.z, 0.0}) normals.push_back(static_cast<float>(c));
  }
  const std::size_t count = normals.size() / 4;
  std::vector<std::int16_t> wide(normals.size());
  meshopt_encodeFilterOct(wide.data(), count, 8, 16, normals.data());
  std::vector<std::int16_t> expected = wide;
  meshopt_decodeFilterOct(expected.data(), count, 8);
  const auto read = Filtered(MeshoptFilter::kOctahedral, 8, wide);
  std::vector<std::int8_t> narrow(normals.size());
  meshopt_encodeFilterOct(narrow.data(), count, 4, 8, normals.data());
  std::vector<std::int8_t> narrow_expected = narrow;
  meshopt_decodeFilterOct(narrow_expected.data(), count, 4);
  const auto narrow_read = Filtered(MeshoptFilter::kOctahedral, 4, narrow);
  for (std::size_t i = 0; i < normals.size(); ++i) {
    if (i % 4 == 3) continue;
    ASSERT_NEAR(read[i], expected[i], 1) << i;
    ASSERT_NEAR(read[i] / 32767.0, static_cast<double>(normals[i]), 1e-4) << i;
    ASSERT_NEAR(narrow_read[i], narrow_expected[i], 1) << i;
    ASSERT_NEAR(narrow_read[i] / 127.0, static_cast<double>(normals[i]), 0.03) << i;
  }
}

TEST(MeshoptFilters, ReadQuaternionsAsTheLibraryDoesWithinAUnit) {
  std::mt19937_64 random(test::Seed() + 2);
  std::normal_distribution<float> normal;
  std::vector<float> rotations;
  for (int i = 0; i < 1000; ++i) {
    std::array<float, 4> q = {normal(random), normal(random), normal(random), normal(random)};
    const float length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (const float c : q) rotations.push_back(c / length);
  }
  std::vector<std::int16_t> encoded(rotations.size());
  meshopt_encodeFilterQuat(encoded.data(), 1000, 8, 12, rotations.data());
  std::vector<std::int16_t> expected = encoded;
  meshopt_decodeFilterQuat(expected.data(), 1000, 8);
  const auto read = Filtered(MeshoptFilter::kQuaternion, 8, encoded);
  for (std::size_t i = 0; i < read.size(); ++i) ASSERT_NEAR(read[i], expected[i], 1) << i;
}

TEST(MeshoptFilters, ReadExponentsAsTheLibraryDoesBitForBit) {
  std::mt19937_64 random(test::Seed() + 3);
  std::vector<std::uint32_t> encoded(4096);
  for (std::uint32_t& number : encoded) {
    const auto exponent = static_cast<std::int32_t>(random() % 201) - 100;
    number = static_cast<std::uint32_t>(exponent) << 24 | (random() & 0xffffff);
  }
  std::vector<std::uint32_t> expected = encoded;
  meshopt_decodeFilterExp(expected.data(), expected.size() / 4, 16);
  EXPECT_EQ(Filtered(MeshoptFilter::kExponential, 16, encoded), expected);
}

TEST(MeshoptFilters, TakeAnyNumbers) {
  const std::vector<std::int16_t> numbers = RandomShorts(40'000);
  for (const auto& [filter, stride] : {std::pair{MeshoptFilter::kOctahedral, 4},
                                       {MeshoptFilter::kOctahedral, 8},
                                       {MeshoptFilter::kQuaternion, 8},
                                       {MeshoptFilter::kExponential, 4},
                                       {MeshoptFilter::kNone, 4}}) {
    EXPECT_EQ(Filtered(filter, static_cast<std::uint64_t>(stride), numbers).size(), numbers.size());
  }
  const std::vector<std::int16_t> zero(8, 0);
  EXPECT_EQ(Filtered(MeshoptFilter::kOctahedral, 8, zero), zero);
}

}  // namespace
}  // namespace kdray::core
