#include "clients/cpp/sample/sample_rays.h"

#include <cmath>
#include <random>

namespace kdray::client {

std::vector<float> RaysTowardsBox(const Box& box, std::uint64_t count, std::uint64_t seed) {
  std::mt19937_64 engine(seed);
  // Not uniform_real_distribution, whose sequence depends on the library.
  const auto uniform = [&] { return static_cast<double>(engine() >> 11) * 0x1p-53; };

  Point center;
  double radius = 0;
  for (int axis = 0; axis < 3; ++axis) {
    center[axis] = box.min[axis] / 2 + box.max[axis] / 2;
    radius = std::hypot(radius, box.max[axis] - box.min[axis]);
  }
  if (radius == 0) radius = 1;  // for a box that is a point

  std::vector<float> rows;
  rows.reserve(6 * count);
  for (std::uint64_t i = 0; i < count; ++i) {
    // A direction uniform on the sphere: a point uniform in the unit ball, normalised.
    Point direction;
    double square;
    do {
      square = 0;
      for (double& x : direction) {
        x = 2 * uniform() - 1;
        square += x * x;
      }
    } while (square > 1 || square < 1e-6);
    Point origin;
    for (int axis = 0; axis < 3; ++axis)
      origin[axis] = center[axis] + radius * direction[axis] / std::sqrt(square);
    for (const double x : origin) rows.push_back(static_cast<float>(x));
    for (int axis = 0; axis < 3; ++axis) {
      const double target = std::lerp(box.min[axis], box.max[axis], uniform());
      rows.push_back(static_cast<float>(target - origin[axis]));
    }
  }
  return rows;
}

}  // namespace kdray::client
