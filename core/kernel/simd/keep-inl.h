// SPDX-License-Identifier: Apache-2.0
// What a search keeps of the hits that it is offered: the closest one, for `closest` and `any`, or
// all, for `count` and `all`.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/geometry/vec3.h"
#include "core/intersect/hit_sides.h"
#include "core/kernel/kernel.h"
#include "core/kernel/ray_hits.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/triangle_set.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// Where a candidate's corners are at hand: a block and its lane, or nowhere.
struct BlockLane {
  const LeafBlock* block = nullptr;
  unsigned lane = 0;
};

/// Whether the job's filter, which is not null, keeps a hit. The block saves the way to the mesh,
/// whose vertices are seldom in a cache; it has them rounded if they are doubles.
__attribute__((noinline)) inline bool FilterKeeps(const KernelJob& job, std::size_t row,
                                                  PrimitiveId id, BlockLane at) {
  if (at.block == nullptr || job.mesh->has_double_vertices()) {
    return job.filter->Keeps(job.rays[row], id);
  }
  std::array<Vec3d, 3> corners;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto& corner = at.block->corner[c];
    corners[c] = {static_cast<double>(corner[0][at.lane]), static_cast<double>(corner[1][at.lane]),
                  static_cast<double>(corner[2][at.lane])};
  }
  return KeepsHit(job.filter_options, job.mesh->frame(), job.rays[row], corners);
}

/// The triangles that a search for all hits has met, of a tree that may have one in several leaves.
/// The first are compared in lanes. Of more, a count keeps a hash table; a list drops repeats
/// later.
class SeenTriangles {
 public:
  void Begin() {
    size_ = 0;
    has_many_ = false;
  }
  /// Whether the triangle was not met before; from now on it was.
  KDRAY_INLINE bool IsNew(const KernelJob& job, PrimitiveId id) {
    const I8 wanted = SetI8(id);
    for (std::size_t i = 0; i < size_; i += 8) {
      if (EqualLanes(Load(first_ + i), wanted) != 0) return false;
    }
    if (size_ == kFirst) return IsNewOfMany(job, id);
    if (size_ % 8 == 0) Store(SetI8(kNoPrimitive), first_ + size_);
    first_[size_++] = id;
    return true;
  }

 private:
  __attribute__((noinline)) bool IsNewOfMany(const KernelJob& job, PrimitiveId id) {
    if (!has_many_ && job.counts != nullptr) many_.Clear(job.mesh->triangle_count());
    has_many_ = true;
    return job.counts == nullptr || many_.Insert(id);
  }

  static constexpr std::size_t kFirst = 64;
  alignas(32) PrimitiveId first_[kFirst];
  std::size_t size_;  // of first_
  bool has_many_;
  TriangleSet many_;  // the others
};

/// What a search for all hits of a ray has found.
struct AllOfRay {
  std::uint32_t count;
  SeenTriangles seen;
  NearestHits nearest;

  void Begin(const KernelJob& job) {
    count = 0;
    seen.Begin();
    if (job.counts == nullptr) nearest.Begin(job.lists.max_hits);
  }
  /// The candidates, lanes of a block, that the search has not met in another leaf.
  KDRAY_INLINE unsigned New(const KernelJob& job, const LeafBlock& block, unsigned candidates) {
    if (!job.has_repeats) return candidates;
    unsigned found = 0;
    for (; candidates != 0; candidates &= candidates - 1) {
      const auto lane = static_cast<unsigned>(__builtin_ctz(candidates));
      found |= static_cast<unsigned>(seen.IsNew(job, block.IdOf(lane))) << lane;
    }
    return found;
  }
  /// Whether the job's filter keeps a triangle.
  bool Keeps(const KernelJob& job, std::size_t row, PrimitiveId id, BlockLane at) const {
    return job.filter == nullptr || FilterKeeps(job, row, id, at);
  }
  /// Takes a triangle within the ray's interval. Returns whether the list is now full.
  bool Take(const KernelJob& job, std::size_t row, const Hit& hit, BlockLane at) {
    if (!Keeps(job, row, hit.primitive_id, at)) return false;
    if (job.counts != nullptr) {
      ++count;
      return false;
    }
    nearest.Add(hit);
    return nearest.IsFull();
  }
  /// Stores a list, with the key for t, if it is short, whole, and without equal keys, so without
  /// repeats. Else returns false. Each hit's place is the number of smaller keys: no branch depends
  /// on the order.
  bool StoreShort(const KernelJob& job, std::size_t row, int exponent) {
    constexpr std::size_t kMost = 32;
    const std::span<const Hit> hits = nearest.hits();
    const std::size_t size = hits.size();
    if (size > std::min(kMost, job.lists.max_hits) || nearest.is_truncated()) return false;
    alignas(32) double key[kMost] = {};
    alignas(32) std::int64_t place[kMost];
    for (std::size_t i = 0; i < size; ++i) key[i] = hits[i].t;
    unsigned ties = 0;
    for (std::size_t i = 0; i < size; i += 4) {
      const D4 mine = Load4(key + i);
      L4 smaller = {}, equal = {};  // how many, the latter from i on
      for (std::size_t k = 0; k < i; ++k) smaller -= L4(Set4(key[k]) < mine);
      for (std::size_t k = i; k < size; ++k) {
        smaller -= L4(Set4(key[k]) < mine);
        equal -= L4(Set4(key[k]) == mine);
      }
      ties |= Bits(L4(equal > 1)) & ((1u << std::min<std::size_t>(4, size - i)) - 1);
      __builtin_memcpy(place + i, &smaller, sizeof(smaller));
    }
    if (ties != 0) return false;
    const std::span<Hit> to = NearestHits::Append(row, size, false, job.lists);
    for (std::size_t i = 0; i < size; ++i) {
      to[static_cast<std::size_t>(place[i])] = {ToCallerT(hits[i].t, exponent), hits[i].u,
                                                hits[i].v, hits[i].primitive_id};
    }
    return true;
  }
  void Store(const KernelJob& job, std::size_t row) const {
    if (job.counts != nullptr) {
      job.counts[row] = count;
    } else {
      nearest.Store(row, job.lists);
    }
  }
};

/// The common part of searches with a vector form of their triangle intersection: RoundedOrder in
/// plain numbers.
struct RoundedSearch {
  static constexpr bool kBeginsUsual = false;  ///< whether there is a BeginUsual
  CullRay cull;
  int exponent;
  double shift, t_min, t_max;
  std::size_t row;

  static std::optional<LocalRay> MakeRay(const Ray& ray, const MeshFrame& frame) {
    return MakeLocalRay(ray, frame);
  }
  void BeginRay(const LocalRay& local, std::size_t at) {
    exponent = local.exponent;
    shift = local.shift;
    t_min = local.t_min;
    t_max = local.t_max;
    row = at;
  }
  KDRAY_INLINE bool IsInInterval(double key) const {
    const double t = ToCallerT(key, exponent);
    return t >= t_min && t <= t_max;
  }
  /// The same of four keys.
  KDRAY_INLINE unsigned AreInInterval(D4 key) const {
    if (exponent < -1022 || exponent > 1023) {
      unsigned inside = 0;
      for (unsigned k = 0; k < 4; ++k) {
        inside |= static_cast<unsigned>(IsInInterval(key[k])) << k;
      }
      return inside;
    }
    // ToCallerT, lane by lane.
    const D4 most = Set4(std::numeric_limits<double>::max());
    const D4 t = Min(Max(key * Set4(PowerOfTwo(exponent)), -most), most);
    return Bits(L4((t >= Set4(t_min)) & (t <= Set4(t_max))));
  }
};

/// Keeps a ray's closest hit, as ClosestSearch does.
struct KeepClosest : RoundedSearch {
  static constexpr bool kKeepsAll = false;
  bool found;
  PrimitiveId best_id;
  double best_key, best_u, best_v;  // the key is s + shift

  void BeginRounded(const KernelJob&, const LocalRay& local, std::size_t at) {
    BeginRay(local, at);
    found = false;
    best_id = kNoPrimitive;
  }
  /// The candidates, lanes of a block, without the best so far: a kd-tree may have it in several
  /// leaves.
  KDRAY_INLINE unsigned New(const KernelJob&, const LeafBlock& block, unsigned candidates) const {
    return candidates & ~EqualLanes(Load(block.id) & SetI8(LeafBlock::kIdMask), SetI8(best_id));
  }
  KDRAY_INLINE void Offer(const KernelJob& job, double s, double u, double v, PrimitiveId id,
                          BlockLane at) {
    const double key = s + shift;
    if (found && !Closer(key, id, best_key, best_id)) return;
    if (!IsInInterval(key)) return;
    if (job.filter != nullptr && !FilterKeeps(job, row, id, at)) return;
    found = true;
    best_key = key;
    best_u = u;
    best_v = v;
    best_id = id;
    // RoundedOrder::Limit.
    cull.exit = std::min(cull.exit, RoundedUp(s + std::fabs(shift) * 0x1p-50));
  }

  struct Answers {
    KDRAY_INLINE void Add(const KernelJob& job, const KeepClosest& search) {
      job.hits[search.row] = search.found ? Hit{ToCallerT(search.best_key, search.exponent),
                                                search.best_u, search.best_v, search.best_id}
                                          : Hit{};
    }
    void Flush(const KernelJob&) {}
  };
};

/// Counts a ray's triangles, or keeps the nearest ones of a list, with the key for t.
struct KeepAll : RoundedSearch {
  static constexpr bool kKeepsAll = true;
  // As KeepClosest has a member: this search never ends early.
  static constexpr bool found = false;  // NOLINT(readability-identifier-naming)
  AllOfRay all;

  void BeginRounded(const KernelJob& job, const LocalRay& local, std::size_t at) {
    BeginRay(local, at);
    all.Begin(job);
  }
  KDRAY_INLINE unsigned New(const KernelJob& job, const LeafBlock& block, unsigned candidates) {
    return all.New(job, block, candidates);
  }
  KDRAY_INLINE void Offer(const KernelJob& job, double s, double u, double v, PrimitiveId id,
                          BlockLane at) {
    const double key = s + shift;
    if (IsInInterval(key)) Take(job, {key, u, v, id}, at);
  }

  /// Takes four triangles that are hit, where a bit is set; `at` has their places.
  KDRAY_INLINE void OfferFour(const KernelJob& job, unsigned hit, D4 s, const double* u,
                              const double* v, const BlockLane* at) {
    const D4 key = s + Set4(shift);
    alignas(32) double key_of[4];
    Store(key, key_of);
    for (hit &= AreInInterval(key); hit != 0; hit &= hit - 1) {
      const auto k = static_cast<std::size_t>(__builtin_ctz(hit));
      const PrimitiveId id = at[k].block->IdOf(at[k].lane);
      if (all.Take(job, row, {key_of[k], u[k], v[k], id}, at[k])) Shrink(job);
    }
  }

  struct Answers {
    void Add(const KernelJob& job, KeepAll& search) {
      if (job.counts == nullptr) {
        if (search.all.StoreShort(job, search.row, search.exponent)) return;
        search.all.nearest.KeepNearest(job.poll);
        for (Hit& hit : search.all.nearest.hits()) hit.t = ToCallerT(hit.t, search.exponent);
      }
      search.all.Store(job, search.row);
    }
    void Flush(const KernelJob&) {}
  };

 private:
  __attribute__((noinline)) void Take(const KernelJob& job, const Hit& hit, BlockLane at) {
    if (all.Take(job, row, hit, at)) Shrink(job);
  }
  /// Drops hits of a full list.
  __attribute__((noinline)) void Shrink(const KernelJob& job) {
    const double key = all.nearest.KeepNearest(job.poll);
    // As RoundedOrder::Limit, with the rounding of key - shift.
    cull.exit = std::min(cull.exit,
                         RoundedUp((key - shift) + (std::fabs(key) + std::fabs(shift)) * 0x1p-50));
  }
};

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
