// SPDX-License-Identifier: Apache-2.0
// The interleaved kernel: keeps 16 rays in flight and advances each by one step in turn. A single
// ray waits for memory and mispredicted branches at every step; with 16 rays the waits overlap. For
// unrelated rays.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "core/accel/wide/wide_tree.h"
#include "core/geometry/hit.h"
#include "core/geometry/local_ray.h"
#include "core/kernel/kernel.h"
#include "core/kernel/simd/isa.h"
#include "core/kernel/simd/node_step-inl.h"
#include "core/kernel/simd/rays-inl.h"
#include "core/kernel/simd/vectors-inl.h"

KDRAY_BEGIN_ISA();
namespace kdray::core::KDRAY_ISA {

/// Writes the answer of a ray that needs no search; counts and lists are 0 and empty already.
KDRAY_INLINE void AnswerWithoutSearch(const KernelJob& job, std::size_t row, bool valid) {
  if (job.hits != nullptr) {
    job.hits[row] = Hit{};
    if (!valid) job.hits[row].t = std::numeric_limits<double>::quiet_NaN();
  } else if (job.occluded != nullptr) {
    job.occluded[row] = 0;
  }
}

/// Begins the search of a ray of PrepareUsual.
template <class Search>
KDRAY_INLINE void BeginUsualSearch(const KernelJob& job, const FrameVectors& frame,
                                   const LocalRay& usual, std::size_t row, Search* search) {
  if constexpr (Search::kBeginsUsual) {
    search->BeginUsual(job, frame, usual, row);
  } else {
    search->Begin(job, usual, row);
  }
}

/// Begins a row's search. False if the row has its answer already: it is invalid, or does not meet
/// the mesh's box.
template <class Search>
KDRAY_INLINE bool BeginSearch(const KernelJob& job, const FrameVectors& frame, std::size_t row,
                              Search* search) {
  LocalRay usual;
  if (PrepareUsual(job.rays, row, frame, &usual, &search->cull)) {
    BeginUsualSearch(job, frame, usual, row, search);
  } else {
    const Ray ray = job.rays[row];
    const bool valid = IsValid(ray);
    const std::optional<LocalRay> local =
        valid ? Search::MakeRay(ray, job.mesh->frame()) : std::nullopt;
    if (!local) {
      AnswerWithoutSearch(job, row, valid);
      return false;
    }
    Prepare(*local, &search->cull);
    search->Begin(job, *local, row);
  }
  if (MeetsRoot(*job.tree, search->cull)) return true;
  AnswerWithoutSearch(job, row, true);
  return false;
}

template <class Search, bool kAny>
class Interleaved {
 public:
  explicit Interleaved(const KernelJob& job)
      : job_(job), tree_(*job.tree), frame_(job.mesh->frame()) {
    // A step stores all eight places of the stack above its top.
    capacity_ = tree_.stack_size + WideNode::kWidth;
    memory_.resize(2 * kSlots * capacity_);
    for (std::size_t i = 0; i < kSlots; ++i) {
      slots_[i].enter = reinterpret_cast<float*>(memory_.data()) + 2 * i * capacity_;
      slots_[i].child = memory_.data() + (2 * i + 1) * capacity_;
    }
  }

  void Run(std::size_t first, std::size_t last) {
    next_ = first;
    last_ = last;
    inner_size_ = leaf_size_ = 0;
    for (std::uint32_t i = 0; i < kSlots; ++i) Refill(i);
    while (inner_size_ + leaf_size_ != 0) {
      if (job_.poll->Spend((inner_size_ + leaf_size_) * kStepWork)) return;
      std::uint32_t work[kSlots];
      const std::size_t inner = inner_size_;
      std::copy_n(inner_, inner, work);
      inner_size_ = 0;
      for (std::size_t k = 0; k < inner; ++k) {
        Slot& slot = slots_[work[k]];
        Step(&slot);
        Continue(work[k]);
      }
      const std::size_t leaf = leaf_size_;
      std::copy_n(leaf_, leaf, work);
      leaf_size_ = 0;
      for (std::size_t k = 0; k < leaf; ++k) {
        Slot& slot = slots_[work[k]];
        TestLeaf(&slot);
        Continue(work[k]);
      }
    }
    answers_.Flush(job_);
  }

 private:
  static constexpr std::uint32_t kSlots = 16;

  struct Slot {
    Search search;
    float* enter;          // the stack: where the ray enters, and
    std::uint32_t* child;  // what
    std::uint32_t size = 0;
    std::uint32_t current = 0;
    std::size_t row = 0;
  };

  // Whether the search meets everything on the ray's way, so that the order does not matter.
  KDRAY_INLINE bool IsUnordered() const {
    if constexpr (Search::kKeepsAll) return job_.counts != nullptr;
    return false;
  }

  KDRAY_INLINE void Step(Slot* slot) {
    if (IsUnordered()) {
      const WideNode& node = tree_.nodes[slot->current];
      const unsigned met = MetChildren(node, slot->search.cull);
      Store(Compress(met, Load(node.child)), slot->child + slot->size);
      slot->size += static_cast<std::uint32_t>(__builtin_popcount(met));
      return;
    }
    const NodeStep step = Intersect(tree_.nodes[slot->current], slot->search.cull);
    Store(Compress(step.met, step.enter), slot->enter + slot->size);
    Store(Compress(step.met, step.child), slot->child + slot->size);
    slot->size += static_cast<std::uint32_t>(__builtin_popcount(step.met));
  }

  KDRAY_INLINE void TestLeaf(Slot* slot) {
    const LeafBlock* block = &tree_.blocks[slot->current & ~WideChild::kLeafBit];
    for (;; ++block) {
      slot->search.Test(job_, *block, LeafBlock::kAllLanes);
      if (kAny && slot->search.found) {
        slot->size = 0;
        return;
      }
      if (block->IsLast() || job_.poll->Spend(kBlockWork)) return;
    }
  }

  // Takes the next entry of the slot's stack, or the next ray.
  KDRAY_INLINE void Continue(std::uint32_t index) {
    Slot& slot = slots_[index];
    while (slot.size != 0) {
      --slot.size;
      // Boxes are padded, so lower entries of the stack may begin earlier.
      if (!IsUnordered() && slot.enter[slot.size] > slot.search.cull.exit) continue;
      slot.current = slot.child[slot.size];
      Enqueue(index, slot.current);
      return;
    }
    if constexpr (kAny) {
      job_.occluded[slot.row] = slot.search.found ? 1 : 0;
    } else {
      answers_.Add(job_, slot.search);
    }
    Refill(index);
  }

  KDRAY_INLINE void Enqueue(std::uint32_t index, std::uint32_t child) {
    if (job_.prefetch) PrefetchChild(tree_, child);
    // Written to both lists, but only one grows, because a branch would be unpredictable.
    const std::uint32_t is_leaf = child >> 31;
    inner_[inner_size_] = index;
    leaf_[leaf_size_] = index;
    inner_size_ += 1 - is_leaf;
    leaf_size_ += is_leaf;
  }

  void Refill(std::uint32_t index) {
    Slot& slot = slots_[index];
    while (next_ < last_) {
      if (job_.poll->Spend(kBeginWork)) return;
      const std::size_t row = job_.rows != nullptr ? job_.rows[next_] : next_;
      ++next_;
      if (job_.rows != nullptr && next_ + kSlots < last_) {
        job_.rays.Prefetch(job_.rows[next_ + kSlots]);
      }
      if (!BeginSearch(job_, frame_, row, &slot.search)) continue;
      slot.row = row;
      slot.size = 0;
      slot.current = tree_.root;
      Enqueue(index, slot.current);
      return;
    }
  }

  const KernelJob& job_;
  const WideTree& tree_;
  const FrameVectors frame_;
  std::size_t capacity_ = 0;
  std::size_t next_ = 0, last_ = 0;
  std::uint32_t inner_[kSlots + 1], leaf_[kSlots + 1];
  std::size_t inner_size_ = 0, leaf_size_ = 0;
  std::vector<std::uint32_t> memory_;
  Slot slots_[kSlots];
  typename Search::Answers answers_;
};

template <class Search, bool kAny>
void TraceInterleaved(const KernelJob& job, std::size_t first, std::size_t last) {
  if (job.tree->root == WideChild::kEmpty) {
    for (std::size_t i = first; i < last; ++i) {
      const std::size_t row = job.rows != nullptr ? job.rows[i] : i;
      AnswerWithoutSearch(job, row, IsValid(job.rays[row]));
    }
    return;
  }
  const auto interleaved = std::make_unique<Interleaved<Search, kAny>>(job);
  interleaved->Run(first, last);
}

}  // namespace kdray::core::KDRAY_ISA
KDRAY_END_ISA();
