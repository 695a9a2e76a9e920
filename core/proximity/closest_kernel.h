// SPDX-License-Identifier: Apache-2.0
// The kernels of point queries, one for each instruction set: they walk the wide tree with vectors.
// A kernel only culls; the judges of core/proximity/point_search.h decide.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/accel/wide/wide_tree.h"
#include "core/base/cancel_poll.h"
#include "core/geometry/hit.h"
#include "core/geometry/triangle_mesh.h"
#include "core/geometry/vec3.h"
#include "core/kernel/simd_level.h"
#include "core/proximity/point_search.h"

namespace kdray::core {

/// Points with larger components are not for the kernels, whose boxes and filters are in float.
inline constexpr double kKernelRange = 64;

/// A child that a walk visits later.
struct PointStackEntry {
  float square;  ///< lower bound of its squared distance
  std::uint32_t child;
};

/// One thread's work on a mesh.
struct PointJob {
  const WideTree* tree = nullptr;
  const TriangleMesh* mesh = nullptr;
  std::span<PointStackEntry> stack;  ///< tree->stack_size entries
  CancelPoll* poll = nullptr;
};

/// closest[i] = the closest triangle of points[i], by DoubleJudge; kNoPrimitive without one. Each
/// result is the first candidate for the next point, so neighbours should be near each other.
/// Unspecified once the poll has stopped.
using ClosestKernel = void (*)(const PointJob& job, std::span<const SearchPoint> points,
                               std::span<PrimitiveId> closest);

/// Offers `judge`, which has begun with `point`, every triangle that may win.
using ExactClosestKernel = void (*)(const PointJob& job, const SearchPoint& point,
                                    ExactJudge* judge);

struct PointKernels {
  ClosestKernel closest;
  ExactClosestKernel exact;
};
/// Safe from many threads at once. The level must be supported by the processor.
PointKernels FindPointKernels(SimdLevel level, bool double_vertices);

}  // namespace kdray::core
