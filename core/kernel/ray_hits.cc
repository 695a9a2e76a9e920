// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/ray_hits.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/polled_sort.h"

namespace kdray::core {
namespace {

// Work (CancelPoll) of moving a hit in a sort.
constexpr std::uint64_t kHitWork = 16;
// Most rays have fewer hits, so their lists are sorted once.
constexpr std::size_t kLeastFull = 64;
// Hits of a block that are added to the batch's total together.
constexpr std::size_t kCounted = 1024;

}  // namespace

void NearestHits::Begin(std::size_t max_hits) {
  max_hits_ = max_hits;
  full_ = std::max(kLeastFull, max_hits > hits_.max_size() / 2 ? max_hits : 2 * max_hits);
  is_truncated_ = false;
  hits_.clear();
}

std::span<Hit> NearestHits::DropRepeats(CancelPoll* poll) {
  // Of a triangle's entries, one with a known t comes first.
  const auto is_unknown = [](const Hit& hit) { return std::isnan(hit.t); };
  PolledSort(std::span(hits_), kHitWork, poll, [&](const Hit& a, const Hit& b) {
    return a.primitive_id < b.primitive_id ||
           (a.primitive_id == b.primitive_id && !is_unknown(a) && is_unknown(b));
  });
  hits_.erase(
      std::unique(hits_.begin(), hits_.end(),
                  [](const Hit& a, const Hit& b) { return a.primitive_id == b.primitive_id; }),
      hits_.end());
  return Unknown();
}

std::span<Hit> NearestHits::Unknown() {
  const auto unknown =
      std::partition(hits_.begin(), hits_.end(), [](const Hit& hit) { return !std::isnan(hit.t); });
  return {unknown, hits_.end()};
}

double NearestHits::KeepNearest(const std::function<void(std::span<Hit>)>& order_ties,
                                CancelPoll* poll) {
  if (hits_.size() > 1) {
    PolledSort(std::span(hits_), kHitWork, poll, [](const Hit& a, const Hit& b) {
      return Closer(a.t, a.primitive_id, b.t, b.primitive_id);
    });
  }
  // A triangle has the same t from every leaf.
  hits_.erase(
      std::unique(hits_.begin(), hits_.end(),
                  [](const Hit& a, const Hit& b) { return a.primitive_id == b.primitive_id; }),
      hits_.end());
  const std::size_t kept = std::min(max_hits_, hits_.size());
  if (order_ties) {
    for (std::size_t first = 0, last = 0; first < kept; first = last) {
      last = first + 1;
      while (last < hits_.size() && hits_[last].t == hits_[first].t) ++last;
      if (last - first > 1) order_ties(std::span(hits_).subspan(first, last - first));
    }
  }
  is_truncated_ = is_truncated_ || kept < hits_.size();
  hits_.resize(kept);
  // Before a hit was dropped, the search must find out whether there is one to drop.
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (!is_truncated_) return kInfinity;
  return kept == 0 ? -kInfinity : hits_.back().t;
}

void NearestHits::Store(std::size_t row, const HitLists& lists) const {
  std::copy(hits_.begin(), hits_.end(), Append(row, hits_.size(), is_truncated_, lists).begin());
}

std::span<Hit> NearestHits::Append(std::size_t row, std::size_t count, bool is_truncated,
                                   const HitLists& lists) {
  std::vector<Hit>& block = lists.blocks[lists.block];
  HitRow& at = lists.rows[row];
  at.first = block.size();
  at.size = static_cast<std::uint32_t>(count);
  at.block = static_cast<std::uint32_t>(lists.block) & 0x7fffffffu;
  at.is_truncated = is_truncated ? 1 : 0;
  block.resize(block.size() + count);
  const std::size_t counted = block.size() / kCounted - at.first / kCounted;
  if (counted != 0) lists.total->fetch_add(counted * kCounted, std::memory_order_relaxed);
  return std::span(block).subspan(at.first);
}

}  // namespace kdray::core
