// SPDX-License-Identifier: Apache-2.0
#include "tests/support/seed.h"

#include <cstdlib>
#include <iostream>

namespace kdray::test {

std::uint64_t Seed() {
  static const std::uint64_t seed = [] {
    const char* text = std::getenv("KDRAY_SEED");
    const std::uint64_t value =
        text != nullptr && *text != '\0' ? std::strtoull(text, nullptr, 10) : 20240229;
    std::cout << "KDRAY_SEED=" << value << '\n';
    return value;
  }();
  return seed;
}

std::mt19937_64 RandomEngine(std::uint64_t stream) {
  std::seed_seq sequence{Seed(), Seed() >> 32, stream, stream >> 32};
  return std::mt19937_64(sequence);
}

}  // namespace kdray::test
