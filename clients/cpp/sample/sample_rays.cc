// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/sample_rays.h"

#include <cmath>

namespace kdray::client {

RaysTowardsBox::RaysTowardsBox(const Box& box, std::uint64_t seed) : box_(box), engine_(seed) {
  for (int axis = 0; axis < 3; ++axis) {
    center_[axis] = box.min[axis] / 2 + box.max[axis] / 2;
    radius_ = std::hypot(radius_, box.max[axis] - box.min[axis]);
  }
  if (radius_ == 0) radius_ = 1;  // for a box that is a point
}

// Not uniform_real_distribution, whose sequence depends on the library.
double RaysTowardsBox::Uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }

std::vector<float> RaysTowardsBox::Next(std::uint64_t count) {
  std::vector<float> rows;
  rows.reserve(6 * count);
  for (std::uint64_t i = 0; i < count; ++i) {
    // A direction uniform on the sphere: a point uniform in the unit ball, normalised.
    Point direction;
    double square;
    do {
      square = 0;
      for (double& x : direction) {
        x = 2 * Uniform() - 1;
        square += x * x;
      }
    } while (square > 1 || square < 1e-6);
    Point origin;
    for (int axis = 0; axis < 3; ++axis) {
      origin[axis] = center_[axis] + radius_ * direction[axis] / std::sqrt(square);
    }
    for (const double x : origin) rows.push_back(static_cast<float>(x));
    for (int axis = 0; axis < 3; ++axis) {
      const double target = std::lerp(box_.min[axis], box_.max[axis], Uniform());
      rows.push_back(static_cast<float>(target - origin[axis]));
    }
  }
  return rows;
}

}  // namespace kdray::client
