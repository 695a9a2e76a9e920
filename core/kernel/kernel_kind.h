// SPDX-License-Identifier: Apache-2.0
// The names of the kernels (core/kernel/kernel.h).
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace kdray::core {

enum class KernelKind : std::uint8_t {
  kInterleaved,  ///< 16 unrelated rays in flight, each advanced in turn
  kStream,       ///< up to 64 similar rays of one octant, taken through the tree together
  kFrustum,      ///< packets of 64 rays with a common origin or target
};
inline constexpr std::array kAllKernelKinds = {KernelKind::kInterleaved, KernelKind::kStream,
                                               KernelKind::kFrustum};

/// "interleaved", "stream", "frustum".
std::string_view Name(KernelKind kernel);

}  // namespace kdray::core
