// SPDX-License-Identifier: Apache-2.0
// Sample rays.
#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "clients/cpp/sample/sample_mesh.h"

namespace kdray::client {

struct Box {
  Point min;
  Point max;
};

/// Rows of ox oy oz dx dy dz, without end. Each ray starts on the sphere around the box (twice its
/// half diagonal) and is aimed at a uniformly random point of the box, which lies at t = 1. The
/// same seed gives the same rays on every machine, however they are divided into calls.
class RaysTowardsBox {
 public:
  RaysTowardsBox(const Box& box, std::uint64_t seed);

  /// The next `count` rows.
  std::vector<float> Next(std::uint64_t count);

 private:
  double Uniform();  // in [0, 1)

  Box box_;
  Point center_;
  double radius_ = 0;
  std::mt19937_64 engine_;
};

}  // namespace kdray::client
