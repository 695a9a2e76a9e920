// SPDX-License-Identifier: Apache-2.0
// The hits of one ray for the queries `count` and `all`: each triangle once, although a kd-tree may
// offer it from several leaves.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <span>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/huge_pages.h"
#include "core/geometry/hit.h"
#include "core/kernel/triangle_set.h"

namespace kdray::core {

/// A row's hits of `all`.
struct HitRow {
  const Hit* hits = nullptr;  ///< in HitPieces
  std::uint32_t size = 0;
  bool is_truncated = false;
};

/// Memory for the hits of a batch. Hits do not move while it lives. Safe from many threads at once.
class HitPieces {
 public:
  /// The free end of a piece, which one thread fills.
  struct Rest {
    Hit* next = nullptr;
    Hit* end = nullptr;
    std::size_t uncounted = 0;  ///< hits that are not yet in HitLists::total
  };
  /// What a thread gave back, or an empty rest.
  Rest Take();
  void GiveBack(const Rest& rest);
  /// Replaces the rest by a new piece for at least `count` hits.
  void Renew(std::size_t count, Rest* rest);

 private:
  std::mutex mutex_;
  std::vector<HugeVector<Hit>> pieces_;
  std::vector<Rest> rests_;
};

/// The output of `all`.
struct HitLists {
  std::size_t max_hits = 0;  ///< of a ray
  HitRow* rows = nullptr;    ///< by row; rows without a hit may be left as they are
  HitPieces* pieces = nullptr;
  HitPieces::Rest* rest = nullptr;            ///< of the tracing thread. TraceBlock sets it.
  std::atomic<std::size_t>* total = nullptr;  ///< hits of all rows so far, or somewhat fewer
};

/// The hits of one ray, for `all`. Reused for one ray after the other. Memory is O(max_hits),
/// however many hits are added.
class NearestHits {
 public:
  /// Forgets the ray before.
  void Begin(std::size_t max_hits);
  /// t orders the hits. A triangle may be added again. When the list is full, the caller must call
  /// KeepNearest() before the next one.
  void Add(const Hit& hit) { hits_.push_back(hit); }
  bool IsFull() const { return hits_.size() >= full_; }

  /// Drops repeated triangles, sorts by (t, id), and keeps the first max_hits. order_ties(hits)
  /// puts hits of equal t into another order. Returns the t beyond which no hit can be kept;
  /// infinity until one was dropped. Unspecified if the poll stops.
  double KeepNearest(CancelPoll* poll) { return KeepNearest({}, poll); }
  double KeepNearest(const std::function<void(std::span<Hit>)>& order_ties, CancelPoll* poll);

  std::span<Hit> hits() { return hits_; }
  /// Whether KeepNearest() has dropped a hit for its t.
  bool is_truncated() const { return is_truncated_; }
  /// Appends the hits to the lists. KeepNearest() was called after the last Add().
  void Store(std::size_t row, const HitLists& lists) const;
  /// Makes room for a row's hits in the lists; the caller writes them.
  static std::span<Hit> Append(std::size_t row, std::size_t count, bool is_truncated,
                               const HitLists& lists);

 private:
  std::size_t max_hits_ = 0;
  std::size_t full_ = 0;
  bool is_truncated_ = false;
  std::vector<Hit> hits_;
};

}  // namespace kdray::core
