// SPDX-License-Identifier: Apache-2.0
// One seed for all random tests, so a failure can be repeated.
#pragma once

#include <cstdint>
#include <random>

namespace kdray::test {

/// The environment variable KDRAY_SEED, else a fixed number. Printed at its first use.
std::uint64_t Seed();

/// A separate generator for each `stream`, so tests do not change each other's numbers.
std::mt19937_64 RandomEngine(std::uint64_t stream);

}  // namespace kdray::test
