// SPDX-License-Identifier: Apache-2.0
#include "core/io/meshopt_filters.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace kdray::core {
namespace {

constexpr std::uint64_t kElementWork = 32;

// f(element) for each element of four numbers, in place.
template <class T, class F>
bool ForEachOfFour(std::span<std::byte> bytes, CancelPoll* poll, const F& f) {
  using Four = std::array<T, 4>;
  return PolledLoop(bytes.size() / sizeof(Four), kElementWork, poll, [&](std::size_t i) {
    Four element;
    std::byte* const at = bytes.data() + i * sizeof element;
    std::memcpy(&element, at, sizeof element);
    f(&element);
    std::memcpy(at, &element, sizeof element);
  });
}

// The nearest integer, halves away from 0. Values beyond the range come from damaged data.
template <class T>
T Rounded(double value) {
  constexpr double kMost = std::numeric_limits<T>::max();
  return static_cast<T>(std::clamp(std::round(value), -kMost, kMost));
}

// x and y are on an octahedron whose corners are at `one`, which is in the place of z.
template <class T>
bool DecodeOctahedral(std::span<std::byte> bytes, CancelPoll* poll) {
  return ForEachOfFour<T>(bytes, poll, [](std::array<T, 4>* element) {
    double x = (*element)[0], y = (*element)[1];
    const double z = (*element)[2] - std::abs(x) - std::abs(y);
    const double fold = std::min(z, 0.0);
    x += x >= 0 ? fold : -fold;
    y += y >= 0 ? fold : -fold;
    const double length = std::sqrt(x * x + y * y + z * z);
    const double scale = length > 0 ? std::numeric_limits<T>::max() / length : 0;
    (*element)[0] = Rounded<T>(x * scale);
    (*element)[1] = Rounded<T>(y * scale);
    (*element)[2] = Rounded<T>(z * scale);
  });
}

// The greatest of four components is left out; the last number has its place, and in its higher
// bits the scale of the others.
bool DecodeQuaternions(std::span<std::byte> bytes, CancelPoll* poll) {
  constexpr double kOne = 32767;
  return ForEachOfFour<std::int16_t>(bytes, poll, [](std::array<std::int16_t, 4>* element) {
    const auto last = static_cast<std::uint16_t>((*element)[3]);
    const std::size_t greatest = last & 3;
    const double scale =
        std::sqrt(0.5) / std::bit_cast<std::int16_t>(static_cast<std::uint16_t>(last | 3));
    const double x = (*element)[0] * scale, y = (*element)[1] * scale, z = (*element)[2] * scale;
    const double w = std::sqrt(std::max(0.0, 1 - x * x - y * y - z * z));
    (*element)[(greatest + 1) % 4] = Rounded<std::int16_t>(x * kOne);
    (*element)[(greatest + 2) % 4] = Rounded<std::int16_t>(y * kOne);
    (*element)[(greatest + 3) % 4] = Rounded<std::int16_t>(z * kOne);
    (*element)[greatest] = Rounded<std::int16_t>(w * kOne);
  });
}

// A mantissa of 24 bits and an exponent of 8, both signed.
bool DecodeExponential(std::span<std::byte> bytes, CancelPoll* poll) {
  return PolledLoop(bytes.size() / 4, kElementWork, poll, [&](std::size_t i) {
    std::byte* const at = bytes.data() + 4 * i;
    std::int32_t bits;
    std::memcpy(&bits, at, sizeof bits);
    const std::int32_t exponent = bits >> 24;
    const auto mantissa = static_cast<std::int32_t>(static_cast<std::uint32_t>(bits) << 8) >> 8;
    const auto number = static_cast<float>(std::ldexp(static_cast<double>(mantissa), exponent));
    std::memcpy(at, &number, sizeof number);
  });
}

}  // namespace

bool ApplyMeshoptFilter(MeshoptFilter filter, std::uint64_t stride, std::span<std::byte> bytes,
                        CancelPoll* poll) {
  switch (filter) {
    case MeshoptFilter::kNone:
      return true;
    case MeshoptFilter::kOctahedral:
      return stride == 4 ? DecodeOctahedral<std::int8_t>(bytes, poll)
                         : DecodeOctahedral<std::int16_t>(bytes, poll);
    case MeshoptFilter::kQuaternion:
      return DecodeQuaternions(bytes, poll);
    case MeshoptFilter::kExponential:
      break;
  }
  return DecodeExponential(bytes, poll);
}

}  // namespace kdray::core
