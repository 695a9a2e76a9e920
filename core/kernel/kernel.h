// SPDX-License-Identifier: Apache-2.0
// The kernels: ways to take many rays through a wide tree together. A kernel only culls. The
// triangle intersection of the precision decides, bit for bit: computed in lanes, by a
// ScalarSearch, or known from bounds of its errors.
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
#include "core/intersect/hit_filter.h"
#include "core/intersect/precision.h"
#include "core/kernel/kernel_kind.h"
#include "core/kernel/ray_hits.h"
#include "core/kernel/scalar_search.h"
#include "core/kernel/simd_level.h"

namespace kdray::core {

/// Work (CancelPoll) of a kernel for one ray: preparing it, a step to a node's children, and a
/// block of triangles.
inline constexpr std::uint64_t kBeginWork = 64;
inline constexpr std::uint64_t kStepWork = 32;
inline constexpr std::uint64_t kBlockWork = 64;

/// What is asked of each ray: its closest hit, whether it has one, or all hits (`count`, `all`).
enum class RayQuery : std::uint8_t { kClosest, kAny, kAll };

/// Whether there is a frustum kernel.
constexpr bool HasFrustum(RayQuery query) { return query != RayQuery::kAll; }

/// The input and output of tracing a range of rays.
struct KernelJob {
  const WideTree* tree = nullptr;
  const TriangleMesh* mesh = nullptr;
  const ScalarSearch* scalar = nullptr;
  Precision precision = Precision::kWatertight;
  const HitFilter* filter = nullptr;  ///< null if it keeps every hit; `scalar` has the same
  HitFilter::Options filter_options;  ///< those of `filter`
  SimdLevel simd = SimdLevel::kBaseline;
  KernelKind kernel = KernelKind::kInterleaved;
  bool alike =
      false;  ///< neighbours are similar: rays that do not form a frustum use the stream kernel
  bool sort = false;      ///< sort similar rays together first
  bool prefetch = false;  ///< for trees larger than the second-level cache

  RayBatch rays = std::span<const Ray>();
  /// The rows to trace, in this order; null: rows first, first + 1, ….
  const std::uint32_t* rows = nullptr;

  // The answers by row; one of the four is set. Counts and lists begin as 0 and empty.
  Hit* hits = nullptr;
  std::uint8_t* occluded = nullptr;
  std::uint32_t* counts = nullptr;
  HitLists lists;
  /// Whether the tree may have a triangle in several leaves.
  bool has_repeats = true;

  RayQuery query() const {
    if (hits != nullptr) return RayQuery::kClosest;
    return occluded != nullptr ? RayQuery::kAny : RayQuery::kAll;
  }

  CancelToken cancel;
  /// Set when the token stopped a block of rays; its rows and later ones then have no answers.
  std::atomic<bool>* stopped = nullptr;
  /// The poll of the tracing thread, which a kernel charges once per step of its walk and once per
  /// block of triangles. TraceBlock sets it.
  CancelPoll* poll = nullptr;
};

/// Traces entries [first, last) of job.rows. All kernels give the same answers. If job.poll stops,
/// some rows have no answer.
using KernelFunction = void (*)(const KernelJob& job, std::size_t first, std::size_t last);

/// Safe from many threads at once. The level must be supported by the processor.
KernelFunction FindKernel(SimdLevel level, KernelKind kernel, Precision precision,
                          bool double_vertices, RayQuery query);

}  // namespace kdray::core
