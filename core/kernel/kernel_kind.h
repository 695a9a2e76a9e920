// The names of the kernels (core/kernel/kernel.h).
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace kdray::core {

enum class KernelKind : std::uint8_t {
  kInterleaved,  ///< 16 rays in flight, each on its own: for rays that have nothing in common
  kStream,       ///< up to 64 rays of one octant that go through the tree together
  kFrustum,      ///< packets of 64 that share their origin and stay close together
};
inline constexpr std::array kAllKernelKinds = {KernelKind::kInterleaved, KernelKind::kStream,
                                               KernelKind::kFrustum};

/// "interleaved", "stream", "frustum".
std::string_view Name(KernelKind kernel);

}  // namespace kdray::core
