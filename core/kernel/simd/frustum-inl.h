// SPDX-License-Identifier: Apache-2.0
// The frustum kernel: takes a packet of 64 rays from one origin, or towards one target, through the
// tree as one. Nodes are culled for all rays by intervals, triangles for each group of 16 rays by
// rectangles, then for each ray by edges; the remaining pairs are tested 16 at a time.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "core/accel/wide/wide_tree.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/frustum_filters-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/node_step-inl.h"
#include "core/kernel/simd/packet-inl.h"
#include "core/kernel/simd/packet_gather-inl.h"
#include "core/kernel/simd/packet_pairs-inl.h"
#include "core/kernel/simd/row_prefetch-inl.h"
#include "core/kernel/simd/rows_by_direction-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// The block after this one, if it is of the same leaf.
KDRAY_INLINE void PrefetchNext(const LeafBlock& block) {
  if (block.IsLast()) return;
  const char* at = reinterpret_cast<const char*>(&block + 1);
  for (int line = 0; line < 5; ++line) __builtin_prefetch(at + 64 * line);
}

/// One packet's traversal, a node or a leaf at a time.
template <class Hits>
class Frustum {
 public:
  explicit Frustum(const KernelJob& job)
      : job_(&job),
        tree_(*job.tree),
        culled_(job.filter_options.cull),
        are_doubles_(job.mesh->has_double_vertices()) {
    capacity_ = tree_.stack_size + WideNode::kWidth;
    memory_.resize(2 * capacity_);
    enter_ = reinterpret_cast<float*>(memory_.data());
    child_ = memory_.data() + capacity_;
  }

  /// Takes rows [first, first + 64) of a job, which differs from the constructor's in its rows at
  /// most, if they form such a packet. The job must live until End().
  FrustumRays::Form Begin(const KernelJob& job, std::size_t first) {
    job_ = &job;
    first_ = first;
    const FrustumRays::Form form = rays_.Gather(job, first);
    if (form != FrustumRays::Form::kPacket) return form;
    most_work_ = rays_.is_wide ? std::min(kMostWideWork, Hits::kMostWork) : Hits::kMostWork;
    hits_.Begin(*job_, rays_);
    // Neighbouring packets are alike.
    if (items_ != 0) is_grouped_ = pairs_ >= kManyOnAverage * items_;
    blocks_ = items_ = pairs_ = 0;
    size_ = 0;
    current_ = tree_.root;
    current_enter_ = rays_.enter;
    exit_ = FindExits();
    return form;
  }

  /// False when the packet is done, abandoned, or the job's poll has stopped. It is abandoned when
  /// it meets so many triangles that few are larger than the distance between rays; then single
  /// rays are faster.
  KDRAY_INLINE bool Step() {
    if (job_->poll->Spend(kStepWork)) return false;
    if ((current_ & WideChild::kLeafBit) == 0) {
      StepDown(tree_.nodes[current_]);
    } else {
      const std::size_t pairs_before = pairs_;
      TestLeaf(current_ & ~WideChild::kLeafBit, current_enter_);
      if (IsTooMuchWork()) return false;
      if (pairs_ != pairs_before) exit_ = FindExits();
    }
    while (size_ != 0) {
      --size_;
      // Entries of a packet are not in order: skip, do not stop.
      if (enter_[size_] > exit_) continue;
      current_ = child_[size_];
      current_enter_ = enter_[size_];
      return true;
    }
    return false;
  }

  /// Writes the answers. Rows to trace alone are appended to `alone`, even if they have an answer.
  /// False if the packet was abandoned.
  bool End(std::vector<std::uint32_t>* alone) {
    if (IsTooMuchWork()) {
      hits_.alone = FrustumRays::kAll;
    } else {
      hits_.Finish(*job_, first_, rays_);
      if (hits_.alone == 0) return true;
    }
    for (std::size_t i = 0; i < FrustumRays::kRays; ++i) {
      if ((hits_.alone >> rays_.order->PlaceOf(i) & 1u) != 0) {
        alone->push_back(static_cast<std::uint32_t>(RowAt(*job_, first_ + i)));
      }
    }
    return !IsTooMuchWork();
  }

 private:
  // Work (CancelPoll) of a block of triangles, for the whole packet.
  static constexpr std::uint64_t kPacketBlockWork = 512;

  // Of a packet with a wide angle, above which it is abandoned.
  static constexpr std::size_t kMostWideWork = 50;

  bool IsTooMuchWork() const { return blocks_ + items_ > most_work_; }

  KDRAY_INLINE void StepDown(const WideNode& node) {
    // Planes by the octant; near planes are multiplied by the largest or the smallest reciprocal,
    // whichever gives the nearer t.
    const auto bound = [&](int axis, bool far) KDRAY_LAMBDA {
      const bool negative = (rays_.octant >> axis & 1u) != 0;
      return Load(negative != far ? node.high[axis] : node.low[axis]);
    };
    F8 near = Set8(rays_.enter);
    F8 far = Set8(exit_);
    for (int axis = 0; axis < 3; ++axis) {
      const F8 low = Set8(rays_.inverse_low[axis]);
      const F8 high = Set8(rays_.inverse_high[axis]);
      const F8 origin = Set8(rays_.origin[axis]);
      const F8 to_near = bound(axis, false) - origin;
      const F8 to_far = bound(axis, true) - origin;
      near = Max(near, Min(to_near * low, to_near * high));
      far = Min(far, Max(to_far * low, to_far * high));
    }
    const I8 order = UnpackOrder(node.order[rays_.octant]);
    const F8 near_in_order = Permute(near, order);
    const I8 children = Permute(Load(node.child), order);
    const unsigned met = Bits(LessEqual(near_in_order, Permute(far, order)));
    Store(Compress(met, near_in_order), enter_ + size_);
    Store(Compress(met, children), child_ + size_);
    const std::size_t pushed = static_cast<std::size_t>(__builtin_popcount(met));
    if (job_->prefetch) {
      for (std::size_t i = size_ + pushed; i-- > size_;) PrefetchChild(tree_, child_[i]);
    }
    size_ += pushed;
  }

  void TestLeaf(std::uint32_t number, float enter) {
    unsigned active = 0;
    for (unsigned g = 0; g < FrustumRays::kGroups; ++g) {
      active |= static_cast<unsigned>(enter <= group_exit_[g]) << g;
    }
    for (;; ++number) {
      const LeafBlock& block = tree_.blocks[number];
      PrefetchNext(block);
      CornersFromOrigin corners;
      for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < 3; ++k) {
          const std::uint32_t axis = rays_.axis[k];
          corners.at[c][k] =
              Load(block.corner[c][axis]) - Set8(rays_.origin[static_cast<int>(axis)]);
        }
      }
      const LanesByGroup lanes = FilterRectangles(rays_, corners, active);
      ++blocks_;
      if (lanes.any != 0) {
        if (is_grouped_) {
          TestBlock<true>(block, number, lanes, corners);
        } else {
          TestBlock<false>(block, number, lanes, corners);
        }
      }
      if (block.IsLast() || job_->poll->Spend(kPacketBlockWork)) break;
    }
  }

  // Lists instead of nested loops, whose branches would be unpredictable. `kGrouped`: whether items
  // that many rays of their group may meet are tested with the whole group.
  template <bool kGrouped>
  KDRAY_INLINE void TestBlock(const LeafBlock& block, std::uint32_t number,
                              const LanesByGroup& lanes, const CornersFromOrigin& corners) {
    constexpr std::size_t kGroups = FrustumRays::kGroups;
    constexpr std::size_t kLanes = LeafBlock::kWidth;
    alignas(64) std::uint32_t items[kGroups * kLanes + kLanes];  // group times 8 and lane
    std::size_t item_count = 0;
    const FrustumEdges edges(rays_, corners);
    for (std::uint32_t g = 0; g < kGroups; ++g) {
      unsigned met = lanes.of[g];
      if ((met & lanes.without) != 0) met &= ~lanes.without | edges.Lanes(rays_, g);
      const I8 item = SetI8(kLanes * g) + I8{0, 1, 2, 3, 4, 5, 6, 7};
      Store(Compress(met, item), items + item_count);
      item_count += static_cast<std::size_t>(__builtin_popcount(met));
    }
    items_ += item_count;
    const typename Hits::Bounds bounds(rays_, corners);
    alignas(64) std::uint32_t place[FrustumRays::kRays * kLanes + 16];
    alignas(64) std::uint32_t lane[FrustumRays::kRays * kLanes + 16];
    std::size_t pair_count = 0;
    struct {
      std::uint32_t item;
      unsigned rays;
    } grouped[kGrouped ? kGroups * kLanes + 1 : 1];
    std::size_t grouped_count = 0;
    for (std::size_t i = 0; i < item_count; ++i) {
      const std::uint32_t group = items[i] / kLanes;
      const unsigned bits = edges.Rays(rays_, group, items[i] % kLanes) &
                            ~static_cast<unsigned>(hits_.done() >> (16 * group));
      const auto rays = static_cast<std::size_t>(__builtin_popcount(bits));
      StoreIndices(bits, 16 * group, place + pair_count);
      Fill16(items[i] % kLanes, lane + pair_count);
      if constexpr (kGrouped) {
        // Written to both lists, kept in one.
        const bool many = rays >= kManyOfGroup;
        grouped[grouped_count] = {items[i], bits};
        grouped_count += many ? 1 : 0;
        pair_count += many ? 0 : rays;
        pairs_ += rays;
      } else {
        pair_count += rays;
      }
    }
    if constexpr (!kGrouped) pairs_ += pair_count;
    for (std::size_t i = 0; i < pair_count; i += 16) {
      const std::size_t left = pair_count - i;
      TestPairs({place + i, lane + i, left >= 16 ? 0xffffu : (1u << left) - 1, &block,
                 static_cast<std::uint32_t>(kLanes) * number},
                bounds);
    }
    for (std::size_t i = 0; i < grouped_count; ++i) {
      const std::uint32_t item = grouped[i].item;
      TestGroup({std::size_t{16} * (item / kLanes), grouped[i].rays, &block,
                 static_cast<std::uint32_t>(kLanes * number + item % kLanes)},
                bounds);
    }
  }

  // Rays of a group that are worth a test of the whole group with one triangle: their numbers need
  // not be collected from many places, nor the hits written one by one.
  static constexpr std::size_t kManyOfGroup = 8;
  // Mean number of rays of an item above which packets have many such items. Elsewhere, as on
  // scans, looking for the few costs more than they save.
  static constexpr std::size_t kManyOnAverage = 4;

  KDRAY_INLINE void TestGroup(const TriangleWithGroup& pairs, const typename Hits::Bounds& bounds) {
    const std::size_t lane = pairs.slot % LeafBlock::kWidth;
    Corners16 corners;
    F16 origin[3], ray[3];
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint32_t axis = Hits::Axis(rays_, k);
      for (int c = 0; c < 3; ++c) corners.at[c][k] = Set16(pairs.block->corner[c][axis][lane]);
      origin[k] = rays_.OriginAt(axis, pairs.first);
      ray[k] = Load16(Hits::RayRow(rays_, static_cast<int>(k)) + pairs.first);
    }
    auto lanes = Hits::Test(corners, origin, ray, bounds, lane);
    CullSides(corners, pairs.first, &lanes);
    hits_.TakeGroup(lanes, pairs, rays_);
  }

  KDRAY_INLINE void TestPairs(const RayTrianglePairs& pairs, const typename Hits::Bounds& bounds) {
    // Places after the last pair are unspecified.
    Corners16 corners;
    for (int c = 0; c < 3; ++c) {
      for (std::uint32_t k = 0; k < 3; ++k) {
        corners.at[c][k] = LookUp8(pairs.block->corner[c][Hits::Axis(rays_, k)], pairs.lane);
      }
    }
    F16 origin[3], ray[3];
    for (std::uint32_t k = 0; k < 3; ++k) {
      origin[k] = rays_.OriginAt(Hits::Axis(rays_, k), pairs.place);
      ray[k] = LookUp64(Hits::RayRow(rays_, static_cast<int>(k)), pairs.place);
    }
    auto lanes = Hits::Test(corners, origin, ray, bounds, pairs.lane);
    CullSides(corners, pairs.place, &lanes);
    hits_.Take(lanes, pairs, rays_);
  }

  /// Drops hits on the culled side; those on an unknown side are not certain. `place` is as for
  /// FrustumRays::OriginAt.
  template <class Lanes, class Place>
  KDRAY_INLINE void CullSides(const Corners16& corners, Place place, Lanes* lanes) const {
    if (culled_ == Cull::kNone || lanes->accepted == 0) return;
    F16 direction[3];
    for (std::uint32_t k = 0; k < 3; ++k) {
      direction[k] = rays_.DirectionAt(Hits::Axis(rays_, k), place);
    }
    const SidesMet met = FindSides(corners, direction, are_doubles_);
    lanes->accepted &= ~(culled_ == Cull::kFront ? met.front : met.back);
    lanes->certain &= met.front | met.back;
  }

  // The groups' exits, and the packet's.
  KDRAY_INLINE float FindExits() {
    for (std::size_t g = 0; g < FrustumRays::kGroups; ++g) {
      group_exit_[g] = Largest(Min(Load16(rays_.exit + 16 * g), Load16(hits_.exits() + 16 * g)));
    }
    return std::max(std::max(group_exit_[0], group_exit_[1]),
                    std::max(group_exit_[2], group_exit_[3]));
  }

  const KernelJob* job_;
  const WideTree& tree_;
  const Cull culled_;
  const bool are_doubles_;
  std::size_t capacity_;
  std::vector<std::uint32_t> memory_;
  float* enter_;          // the stack: where the packet enters, and
  std::uint32_t* child_;  // what
  std::size_t size_ = 0;
  std::uint32_t current_ = 0;
  float current_enter_ = 0;
  float exit_ = 0;
  std::size_t first_ = 0;
  std::size_t most_work_ = 0;
  // Of the packet: blocks that it met, items (a triangle with a group) and pairs of these.
  std::size_t blocks_ = 0, items_ = 0, pairs_ = 0;
  bool is_grouped_ = false;  // see TestBlock
  float group_exit_[FrustumRays::kGroups];
  FrustumRays rays_;
  Hits hits_;
};

/// Fewer rows of a kind are not worth a packet, which would be mostly copies.
constexpr std::size_t kWorthFilling = 16;

/// Traces packets of 64 where possible, the other rays by `rest`.
template <class Hits>
void TraceFrustum(const KernelJob& job, std::size_t first, std::size_t last, KernelFunction rest) {
  std::vector<std::uint32_t> others;
  const auto leave = [&](std::size_t from, std::size_t to) {
    const std::size_t size = others.size();
    others.resize(size + (to - from));
    for (std::size_t i = from; i < to; ++i) {
      others[size + (i - from)] = static_cast<std::uint32_t>(RowAt(job, i));
    }
  };
  if (job.tree->root != WideChild::kEmpty) {
    const auto packet = std::make_unique<Frustum<Hits>>(job);
    using Form = FrustumRays::Form;
    // After rays that did not form a packet, or took too much work, some are skipped.
    unsigned pass_over = 0;
    unsigned next_pass = 1;
    RowsByDirection mixed;
    KernelJob mixed_job = job;
    // Whether the last mixed rows became a packet that was not abandoned.
    bool mixes = true;
    bool all_kept = true;  // no packet was abandoned
    const auto trace_mixed = [&](std::span<const std::uint32_t> rows) {
      mixed_job.rows = rows.data();
      if (!mixes || packet->Begin(mixed_job, 0) != Form::kPacket) {
        all_kept = mixes = false;
        others.insert(others.end(), rows.begin(), rows.end());
        return;
      }
      while (packet->Step()) {
      }
      mixes = packet->End(&others);
      all_kept &= mixes;
    };
    for (; first + FrustumRays::kRays <= last; first += FrustumRays::kRays) {
      if (job.poll->Spend(FrustumRays::kRays * kBeginWork)) return;
      RowPrefetch ahead(job, first, last);
      const Form form = pass_over != 0 ? Form::kOther : packet->Begin(job, first);
      if (form == Form::kPacket) {
        while (packet->Step()) ahead.Some();
      }
      ahead.Rest();
      if (form == Form::kPacket) {
        if (job.poll->stopped()) return;
        if (packet->End(&others)) {
          next_pass = 1;
        } else {
          all_kept = false;
          pass_over = next_pass;
          next_pass *= 4;
        }
        continue;
      }
      pass_over -= pass_over != 0;
      if (form == Form::kOther || !mixes) {
        leave(first, first + FrustumRays::kRays);
        continue;
      }
      const RowsByDirection::Kinds kinds(job, first);
      for (std::size_t i = 0; i < FrustumRays::kRays; ++i) {
        const auto rows = mixed.Add(kinds.of[i], static_cast<std::uint32_t>(RowAt(job, first + i)));
        if (rows.empty()) continue;
        trace_mixed(rows);
        if (job.poll->stopped()) return;
      }
    }
    for (std::size_t kind = 0; kind < RowsByDirection::kKinds; ++kind) {
      const std::span<std::uint32_t> left = mixed.Rest(kind);
      if (!all_kept || left.size() < kWorthFilling) {
        others.insert(others.end(), left.begin(), left.end());
      } else {
        trace_mixed(mixed.Filled(kind));
        if (job.poll->stopped()) return;
      }
    }
  }
  leave(first, last);
  if (others.empty()) return;
  KernelJob remaining = job;
  remaining.rows = others.data();
  rest(remaining, 0, others.size());
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
