// SPDX-License-Identifier: Apache-2.0
// The stream kernel: takes up to 64 rays of one octant, with different origins, through the tree
// together. A node or a block of triangles is loaded once for all rays. Where many rays of 16 are
// at a node they are tested against one box after the other, elsewhere each ray against the eight
// boxes; in a block each ray is tested against the eight triangles. For similar rays without a
// common origin, such as shadow rays of neighbouring pixels, or sorted ones.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/accel/wide/wide_tree.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/filters-inl.h"
#include "core/kernel/simd/interleaved-inl.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/node_step-inl.h"
#include "core/kernel/simd/prepared_rays-inl.h"
#include "core/kernel/simd/rays_by_child-inl.h"
#include "core/kernel/simd/vectors-inl.h"
#include "core/kernel/simd/vectors16-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

template <class Search, bool kAny>
class Stream {
 public:
  explicit Stream(const KernelJob& job) : job_(job), tree_(*job.tree), frame_(job.mesh->frame()) {
    // A step stores all eight places of the stack above its top.
    const std::size_t capacity = tree_.stack_size + WideNode::kWidth;
    enter_.resize(capacity);
    child_.resize(capacity);
    active_.resize(capacity);
  }

  void Run(std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      if (job_.poll->stopped()) return;
      if (job_.rows != nullptr && i + kRays < last) PrefetchRow(job_.rows[i + kRays]);
      Add(job_.rows != nullptr ? job_.rows[i] : i);
    }
    for (unsigned octant = 0; octant < 8; ++octant) Flush(octant);
    answers_.Flush(job_);
  }

 private:
  static constexpr std::size_t kRays = PreparedRays::kRays;
  // Work (CancelPoll) of a node, or a block of triangles, for all rays.
  static constexpr std::uint64_t kTogetherWork = 256;
  static constexpr float kFar = 0x1p100f;  // instead of infinity, which BlockFilter does not accept

  // A ray, and the place of its answer, which is written at about the time of its begin.
  KDRAY_INLINE void PrefetchRow(std::size_t row) const {
    job_.rays.Prefetch(row);
    if (job_.hits != nullptr) __builtin_prefetch(&job_.hits[row], 1);
  }

  // Rows whose rays have one octant.
  struct Queue {
    std::size_t row[kRays];
    std::size_t size = 0;
  };
  // As computed by Prepare.
  KDRAY_INLINE unsigned OctantOf(std::size_t row) const {
    const auto signs = [](const auto& d) KDRAY_LAMBDA {
      return static_cast<unsigned>(std::signbit(d.x)) |
             static_cast<unsigned>(std::signbit(d.y)) << 1 |
             static_cast<unsigned>(std::signbit(d.z)) << 2;
    };
    const RayF* floats = job_.rays.floats();
    return floats != nullptr ? signs(floats[row].direction)
                             : signs(job_.rays.doubles()[row].direction);
  }

  void Add(std::size_t row) {
    const unsigned octant = OctantOf(row);
    Queue& queue = queues_[octant];
    queue.row[queue.size] = row;
    if (++queue.size == kRays) Flush(octant);
  }

  void Flush(unsigned octant) {
    Queue& queue = queues_[octant];
    if (queue.size == 0) return;
    if (job_.poll->Spend(queue.size * kBeginWork)) return;
    const std::uint64_t searched = Begin(&queue);
    if (searched != 0) Traverse(octant, searched);
    for (std::uint64_t rays = searched; rays != 0; rays &= rays - 1) {
      const auto k = static_cast<std::size_t>(__builtin_ctzll(rays));
      if ((begun_ >> k & 1u) == 0) {
        AnswerWithoutSearch(job_, queue.row[k], true);
      } else if constexpr (kAny) {
        job_.occluded[queue.row[k]] = search_[k].found ? 1 : 0;
      } else {
        answers_.Add(job_, search_[k]);
      }
    }
    queue.size = 0;
  }

  // Returns the rays that need a search; the others have their answers. The search of a usual ray
  // begins when it meets its first candidate: many meet none.
  std::uint64_t Begin(Queue* queue) {
    current_ = queue;
    begun_ = 0;
    // Rays are prepared four at a time.
    for (std::size_t k = queue->size; k % 4 != 0; ++k) queue->row[k] = queue->row[0];
    rays_.Prepare(job_.rays, frame_, queue->row, queue->size);
    const std::uint64_t all = ~std::uint64_t{0} >> (64 - queue->size);
    const std::uint64_t usual = rays_.usual & all;
    std::uint64_t searched = usual & rays_.MeetRoot(tree_, queue->size);
    for (std::size_t k = 0; k < queue->size; ++k) {
      if ((searched >> k & 1u) != 0) {
        // Nothing more yet.
      } else if ((usual >> k & 1u) != 0) {
        AnswerWithoutSearch(job_, queue->row[k], true);
        continue;
      } else if (BeginSearch(job_, frame_, queue->row[k], &search_[k])) {
        rays_.Insert(k, search_[k].cull);
        searched |= std::uint64_t{1} << k;
        begun_ |= std::uint64_t{1} << k;
      } else {
        continue;
      }
      rays_.exit[k] = std::min(rays_.exit[k], kFar);
      rays_.enter[k] = std::max(rays_.enter[k], -kFar);
    }
    return searched;
  }

  void Traverse(unsigned octant, std::uint64_t live) {  // live: rays without a final answer
    std::size_t size = 0;
    Push(-std::numeric_limits<float>::infinity(), tree_.root, live, size++);
    while (size != 0) {
      --size;
      std::uint64_t active = active_[size] & live;
      if (active == 0) continue;
      if (job_.poll->Spend(kTogetherWork)) return;
      if ((active & (active - 1)) == 0 && enter_[size] > rays_.exit[__builtin_ctzll(active)]) {
        continue;
      }
      const std::uint32_t child = child_[size];
      if ((child & WideChild::kLeafBit) != 0) {
        TestLeaf(child & ~WideChild::kLeafBit, active, &live);
        if (kAny && live == 0) return;
        continue;
      }
      const std::size_t size_before = size;
      const WideNode& node = tree_.nodes[child];
      size = (active & (active - 1)) == 0 ? StepAlone(node, octant, active, size)
                                          : StepTogether(node, octant, active, size);
      if (job_.prefetch) {
        for (std::size_t i = size; i-- > size_before;) PrefetchChild(tree_, child_[i]);
      }
    }
  }

  KDRAY_INLINE void Push(float enter, std::uint32_t child, std::uint64_t active, std::size_t at) {
    enter_[at] = enter;
    child_[at] = child;
    active_[at] = active;
  }

  // A node's eight planes that rays of the octant meet first, or last.
  KDRAY_INLINE static const float* Planes(const WideNode& node, unsigned octant, unsigned axis,
                                          bool far) {
    const bool negative = (octant >> axis & 1u) != 0;
    return negative != far ? node.high[axis] : node.low[axis];
  }

  // Rays of 16 in a row for which one box after the other is faster than one ray after the other.
#if defined(KDRAY_ISA_AVX512)
  static constexpr int kManyOf16 = 8;
#else
  static constexpr int kManyOf16 = 10;
#endif

  // Adds the rays of a group that meet each child.
  KDRAY_INLINE void MeetTogether(const float* const (&near_planes)[3],
                                 const float* const (&far_planes)[3], std::size_t first,
                                 unsigned group, RaysByChild* met) const {
    F16 inverse[3], origin[3];
    for (int axis = 0; axis < 3; ++axis) {
      inverse[axis] = Load16(rays_.inverse[axis] + first);
      origin[axis] = Load16(rays_.origin_inverse[axis] + first);
    }
    const F16 enter = Load16(rays_.enter + first), exit = Load16(rays_.exit + first);
    met->AddGroup(first, group, [&](std::size_t c) KDRAY_LAMBDA {
      F16 near = enter, far = exit;
      for (int axis = 0; axis < 3; ++axis) {
        near = Max(near, MulSub(Set16(near_planes[axis][c]), inverse[axis], origin[axis]));
        far = Min(far, MulSub(Set16(far_planes[axis][c]), inverse[axis], origin[axis]));
      }
      return Bits(LessEqual(near, far));
    });
  }
  KDRAY_INLINE void MeetAlone(const float* const (&near_planes)[3],
                              const float* const (&far_planes)[3], std::uint64_t active,
                              RaysByChild* met) const {
    F8 near_of[3], far_of[3];
    for (int axis = 0; axis < 3; ++axis) {
      near_of[axis] = Load(near_planes[axis]);
      far_of[axis] = Load(far_planes[axis]);
    }
    for (std::uint64_t rays = active; rays != 0; rays &= rays - 1) {
      const auto k = static_cast<std::size_t>(__builtin_ctzll(rays));
      F8 near = Set8(rays_.enter[k]);
      F8 far = Set8(rays_.exit[k]);
      for (int axis = 0; axis < 3; ++axis) {
        const F8 inverse = Set8(rays_.inverse[axis][k]);
        const F8 origin = Set8(rays_.origin_inverse[axis][k]);
        near = Max(near, MulSub(near_of[axis], inverse, origin));
        far = Min(far, MulSub(far_of[axis], inverse, origin));
      }
      met->AddRay(k, LessEqual(near, far));
    }
  }

  // Pushes the children that rays meet, farthest first.
  KDRAY_INLINE std::size_t StepTogether(const WideNode& node, unsigned octant, std::uint64_t active,
                                        std::size_t size) {
    const float *near_planes[3], *far_planes[3];
    for (unsigned axis = 0; axis < 3; ++axis) {
      near_planes[axis] = Planes(node, octant, axis, false);
      far_planes[axis] = Planes(node, octant, axis, true);
    }
    RaysByChild met;
    std::uint64_t others = active;
    for (std::size_t first = 0; first < kRays; first += 16) {
      const auto group = static_cast<unsigned>(active >> first & 0xffffu);
      if (__builtin_popcount(group) < kManyOf16) continue;
      others &= ~(std::uint64_t{0xffff} << first);
      MeetTogether(near_planes, far_planes, first, group, &met);
    }
    if (others != 0) MeetAlone(near_planes, far_planes, others, &met);
    Store(Set8(-std::numeric_limits<float>::infinity()), &enter_[size]);
    return size + met.StoreMet(node, octant, &child_[size], &active_[size]);
  }

  KDRAY_INLINE std::size_t StepAlone(const WideNode& node, unsigned octant, std::uint64_t active,
                                     std::size_t size) {
    const auto ray = static_cast<std::size_t>(__builtin_ctzll(active));
    const NodeStep step = Intersect(
        node, octant, [&](unsigned axis) KDRAY_LAMBDA { return Planes(node, octant, axis, false); },
        [&](unsigned axis) KDRAY_LAMBDA { return Planes(node, octant, axis, true); },
        [&](int axis) KDRAY_LAMBDA { return rays_.inverse[axis][ray]; },
        [&](int axis) KDRAY_LAMBDA { return rays_.origin_inverse[axis][ray]; }, rays_.enter[ray],
        rays_.exit[ray]);
    Store(Compress(step.met, step.enter), &enter_[size]);
    Store(Compress(step.met, step.child), &child_[size]);
    for (std::size_t i = 0; i < WideNode::kWidth; ++i) active_[size + i] = active;
    return size + static_cast<std::size_t>(__builtin_popcount(step.met));
  }

  KDRAY_INLINE void BeginUsual(std::size_t k) {
    begun_ |= std::uint64_t{1} << k;
    const LocalRay local = rays_.Extract(k, &search_[k].cull);
    BeginUsualSearch(job_, frame_, local, current_->row[k], &search_[k]);
  }

  KDRAY_INLINE void TestLeaf(std::uint32_t number, std::uint64_t active, std::uint64_t* live) {
    for (;; ++number) {
      const LeafBlock& block = tree_.blocks[number];
      const BlockFilter filter(block);
      struct {
        std::uint8_t ray, lanes;
      } candidates[kRays];
      std::size_t count = 0;
      for (std::uint64_t rays = active; rays != 0; rays &= rays - 1) {
        const auto k = static_cast<std::size_t>(__builtin_ctzll(rays));
        const float origin[3] = {rays_.origin[0][k], rays_.origin[1][k], rays_.origin[2][k]};
        const float direction[3] = {rays_.direction[0][k], rays_.direction[1][k],
                                    rays_.direction[2][k]};
        const unsigned lanes = filter.Lanes(origin, direction, rays_.enter[k], rays_.exit[k]);
        // Always written, kept if there are any: a branch would be unpredictable.
        candidates[count] = {static_cast<std::uint8_t>(k), static_cast<std::uint8_t>(lanes)};
        count += lanes != 0 ? 1 : 0;
      }
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t k = candidates[i].ray;
        Search& search = search_[k];
        if ((begun_ >> k & 1u) == 0) BeginUsual(k);
        search.Test(job_, block, candidates[i].lanes);
        rays_.exit[k] = std::min(rays_.exit[k], search.cull.exit);
        if (kAny && search.found) {
          *live &= ~(std::uint64_t{1} << k);
          active &= ~(std::uint64_t{1} << k);
        }
      }
      if (block.IsLast() || active == 0 || job_.poll->Spend(kTogetherWork)) return;
    }
  }

  const KernelJob& job_;
  const WideTree& tree_;
  const FrameVectors frame_;
  // The stack.
  std::vector<float> enter_;           // entry of the first ray, if it is the only one
  std::vector<std::uint32_t> child_;   // what
  std::vector<std::uint64_t> active_;  // a bit for each ray
  Queue queues_[8];
  // The current rays.
  const Queue* current_ = nullptr;
  PreparedRays rays_;
  std::uint64_t begun_ = 0;  // those whose search has begun
  Search search_[kRays];
  typename Search::Answers answers_;
};

template <class Search, bool kAny>
void TraceStream(const KernelJob& job, std::size_t first, std::size_t last) {
  if (job.tree->root == WideChild::kEmpty) {
    return TraceInterleaved<Search, kAny>(job, first, last);
  }
  const auto stream = std::make_unique<Stream<Search, kAny>>(job);
  stream->Run(first, last);
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
