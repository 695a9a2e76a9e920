// SPDX-License-Identifier: Apache-2.0
// The entry of libFuzzer. KDRAY_FUZZ_TARGET names the target; with KDRAY_FUZZ_SEEDS its seeds are
// written to that folder first.
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/fuzz/fuzz_target.h"

namespace {

const kdray::fuzz::FuzzTarget* target = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  static const std::vector<kdray::fuzz::FuzzTarget> all = kdray::fuzz::AllTargets();
  const char* name = std::getenv("KDRAY_FUZZ_TARGET");
  for (const auto& candidate : all) {
    if (name != nullptr && candidate.name == name) target = &candidate;
  }
  if (target == nullptr) {
    std::fputs("KDRAY_FUZZ_TARGET must be one of", stderr);
    for (const auto& candidate : all) std::fprintf(stderr, " %s", candidate.name.data());
    std::fputc('\n', stderr);
    std::exit(2);
  }
  if (const char* folder = std::getenv("KDRAY_FUZZ_SEEDS")) {
    int number = 0;
    for (const auto& seed : target->seeds()) {
      std::ofstream(std::filesystem::path(folder) / ("seed" + std::to_string(number++)))
          << kdray::fuzz::AsText(seed);
    }
  }
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  target->run(std::as_bytes(std::span(data, size)));
  return 0;
}
