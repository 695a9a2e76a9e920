// Sample rays.
#pragma once

#include <cstdint>
#include <vector>

#include "clients/cpp/sample/sample_mesh.h"

namespace kdray::client {

struct Box {
  Point min;
  Point max;
};

/// `count` rows of ox oy oz dx dy dz. Each ray starts on the sphere around the box (twice its half
/// diagonal) and is aimed at a uniformly random point of the box, which lies at t = 1. The same
/// seed gives the same rays on every machine.
std::vector<float> RaysTowardsBox(const Box& box, std::uint64_t count, std::uint64_t seed);

}  // namespace kdray::client
