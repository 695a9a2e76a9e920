// SPDX-License-Identifier: Apache-2.0
// Parsers of bytes from strangers, as functions that a fuzzer calls (libFuzzer's manual, "Fuzz
// Target"). Each holds its parser to what its header promises, not only to staying alive.
#pragma once

#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace kdray::fuzz {

using Bytes = std::vector<std::byte>;

struct FuzzTarget {
  std::string_view name;
  /// Takes any bytes; returns whether they are valid. A broken promise aborts the process.
  bool (*run)(std::span<const std::byte> input);
  /// Valid inputs to begin with.
  std::vector<Bytes> (*seeds)();
};

inline std::ostream& operator<<(std::ostream& out, const FuzzTarget& target) {
  return out << target.name;
}

// One function for each file of targets.
std::span<const FuzzTarget> MeshTargets();
std::span<const FuzzTarget> CodecTargets();
std::span<const FuzzTarget> BatchTargets();
std::span<const FuzzTarget> HttpTargets();
std::span<const FuzzTarget> StoreTargets();

inline std::vector<FuzzTarget> AllTargets() {
  std::vector<FuzzTarget> all;
  for (const auto targets :
       {MeshTargets(), CodecTargets(), BatchTargets(), HttpTargets(), StoreTargets()}) {
    all.insert(all.end(), targets.begin(), targets.end());
  }
  return all;
}

inline std::string_view AsText(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
inline Bytes ToBytes(std::string_view text) {
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

/// Ends the process unless `holds`: libFuzzer then keeps the input.
inline void Require(bool holds, const char* promise) {
  if (holds) return;
  std::fprintf(stderr, "broken promise: %s\n", promise);
  std::abort();
}

}  // namespace kdray::fuzz
