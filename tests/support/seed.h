// One seed for everything random in the tests, so that a failure can be replayed.
#pragma once

#include <cstdint>
#include <random>

namespace kdray::test {

/// The environment variable KDRAY_SEED, else a fixed number. Printed at its first use.
std::uint64_t Seed();

/// A generator of its own for each `stream`, so that tests do not change each other's numbers.
std::mt19937_64 RandomEngine(std::uint64_t stream);

}  // namespace kdray::test
