// SPDX-License-Identifier: Apache-2.0
// The filters of EXT_meshopt_compression, which turn decoded elements into the numbers of an
// accessor. They are not the library's: those differ by a unit between processors, because they use
// the approximate reciprocal root of each.
// Source: Khronos Group, "EXT_meshopt_compression", appendix A.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/cancel_poll.h"

namespace kdray::core {

enum class MeshoptFilter : std::uint8_t { kNone, kOctahedral, kQuaternion, kExponential };

/// Filters elements of `stride` bytes in place; `bytes` are whole elements. Octahedral: four
/// numbers of 8 or 16 bits (stride 4 or 8), of which three become a unit vector, or 0 if they are
/// 0. Quaternion: four numbers of 16 bits (stride 8). Exponential: numbers of 32 bits become floats
/// (stride a multiple of 4). Any input is safe. False when the poll has stopped.
bool ApplyMeshoptFilter(MeshoptFilter filter, std::uint64_t stride, std::span<std::byte> bytes,
                        CancelPoll* poll);

}  // namespace kdray::core
