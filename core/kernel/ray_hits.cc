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
// Hits that a thread adds to the batch's total together.
constexpr std::size_t kCounted = 1024;
// Hits of the first piece, and of the largest: a huge page of them.
constexpr std::size_t kFirstPiece = std::size_t{1} << 11;
constexpr std::size_t kLargestPiece = std::size_t{1} << 16;

}  // namespace

HitPieces::Rest HitPieces::Take() {
  const std::lock_guard lock(mutex_);
  if (rests_.empty()) return {};
  const Rest rest = rests_.back();
  rests_.pop_back();
  return rest;
}

void HitPieces::GiveBack(const Rest& rest) {
  const std::lock_guard lock(mutex_);
  rests_.push_back(rest);
}

void HitPieces::Renew(std::size_t count, Rest* rest) {
  const std::lock_guard lock(mutex_);
  const std::size_t usual =
      std::min(kFirstPiece << std::min<std::size_t>(pieces_.size(), 16), kLargestPiece);
  HugeVector<Hit>& piece = pieces_.emplace_back(std::max(count, usual));
  rest->next = piece.data();
  rest->end = piece.data() + piece.size();
}

void NearestHits::Begin(std::size_t max_hits) {
  max_hits_ = max_hits;
  full_ = std::max(kLeastFull, max_hits > hits_.max_size() / 2 ? max_hits : 2 * max_hits);
  is_truncated_ = false;
  hits_.clear();
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
  HitPieces::Rest& rest = *lists.rest;
  if (count > static_cast<std::size_t>(rest.end - rest.next)) lists.pieces->Renew(count, &rest);
  Hit* const hits = rest.next;
  rest.next += count;
  lists.rows[row] = {hits, static_cast<std::uint32_t>(count), is_truncated};
  rest.uncounted += count;
  if (rest.uncounted >= kCounted) {
    lists.total->fetch_add(rest.uncounted, std::memory_order_relaxed);
    rest.uncounted = 0;
  }
  return {hits, count};
}

}  // namespace kdray::core
