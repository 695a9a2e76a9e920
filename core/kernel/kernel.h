// The kernels: ways to take many rays through a wide tree at once. Each only culls; what a triangle
// answers comes from the one leaf test of the precision, bit for bit, be it computed lane by lane
// or by a ScalarSearch.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/accel/wide/wide_tree.h"
#include "core/base/cancel_poll.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/precision.h"
#include "core/kernel/kernel_kind.h"
#include "core/kernel/scalar_search.h"
#include "core/kernel/simd_level.h"

namespace kdray::core {

/// What kernels count for one ray (CancelPoll): for making it ready, for a step to a node's
/// children, and for a block of triangles.
inline constexpr std::uint64_t kBeginWork = 64;
inline constexpr std::uint64_t kStepWork = 32;
inline constexpr std::uint64_t kBlockWork = 64;

/// What a stretch of rays is traced against, and where its answers go.
struct KernelJob {
  const WideTree* tree = nullptr;
  const TriangleMesh* mesh = nullptr;
  const ScalarSearch* scalar = nullptr;
  Precision precision = Precision::kWatertight;
  SimdLevel simd = SimdLevel::kBaseline;
  KernelKind kernel = KernelKind::kInterleaved;
  bool alike = false;     ///< neighbours resemble each other: what is no frustum goes by the stream
  bool sort = false;      ///< bring rays that are alike together first
  bool prefetch = false;  ///< for trees that the second-level cache does not hold

  RayBatch rays = std::span<const Ray>();
  /// Of the rows to trace, in the order in which they are traced; null: rows first, first + 1, ….
  const std::uint32_t* rows = nullptr;

  // One of the two, by row.
  Hit* hits = nullptr;
  std::uint8_t* occluded = nullptr;

  CancelToken cancel;
  /// Set when the token stopped a block of rays; its rows and later ones then hold no answers.
  std::atomic<bool>* stopped = nullptr;
  /// The meter of the thread that traces, which a kernel asks once per step of its walk and once
  /// per block of triangles. TraceBlock sets it.
  CancelPoll* poll = nullptr;
};

/// Traces entries [first, last) of job.rows. Every kernel gives the same answers. Leaves rows
/// without one when job.poll stops it.
using KernelFunction = void (*)(const KernelJob& job, std::size_t first, std::size_t last);

/// Safe from many threads at once. The level must be supported.
KernelFunction FindKernel(SimdLevel level, KernelKind kernel, Precision precision,
                          bool double_vertices, bool any);

}  // namespace kdray::core
