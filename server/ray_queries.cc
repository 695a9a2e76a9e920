// SPDX-License-Identifier: Apache-2.0
#include "server/ray_queries.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <mutex>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "server/hit_details.h"
#include "server/mapping.h"
#include "server/raw_array.h"

namespace kdray::server {
namespace {

using Clock = std::chrono::steady_clock;

// Rays are handed to the tracer in blocks of this many: large enough for it to sort and share out,
// small enough that the copy of their rows stays in the cache.
constexpr std::size_t kBlockRays = 131'072;
// Rows that one thread reads at a time. They are checked while they are in its first cache.
constexpr std::size_t kReadRows = 512;
// Rows that one thread gives to the sink at a time, which then still are in its first cache.
constexpr std::size_t kPutRows = 512;
// Hits of `all` that a block may have at most.
constexpr std::size_t kBlockHits = std::size_t{1} << 20;
// Hits of `all` that one thread gives to the sink at a time.
constexpr std::size_t kPutHits = 4096;

/// Adds the time of f() to `ms`.
template <class F>
auto Timed(double* ms, const F& f) {
  struct Stop {
    double* ms;
    Clock::time_point start = Clock::now();
    ~Stop() { *ms += std::chrono::duration<double, std::milli>(Clock::now() - start).count(); }
  } stop{ms};
  return f();
}

api::Check ToCheck(const core::Status& status) {
  if (status.ok()) return std::nullopt;
  return ToProblem(status.error());
}

/// body(first, last) over [0, count) in parallel, until `cancel` stops.
template <class Body>
api::Check ForEachPiece(std::size_t count, std::size_t grain, const core::CancelToken& cancel,
                        const Body& body) {
  std::atomic<bool> stopped{false};
  core::ParallelFor(0, count, grain, [&](std::size_t first, std::size_t last) {
    if (stopped.load(std::memory_order_relaxed)) return;
    if (cancel.ShouldStop()) {
      stopped = true;
    } else {
      body(first, last);
    }
  });
  if (stopped) return ToProblem(cancel.ToError());
  return std::nullopt;
}

/// The rows of a batch as core's rays, a block at a time. T is the type of the table's rows, whose
/// order of numbers is that of a ray in memory.
template <class T>
class BatchRays {
  static_assert(sizeof(core::RayOf<T>) == api::kRayNumbers * sizeof(T) &&
                offsetof(core::RayOf<T>, t_min) == 3 * sizeof(T) &&
                offsetof(core::RayOf<T>, direction) == 4 * sizeof(T) &&
                offsetof(core::RayOf<T>, t_max) == 7 * sizeof(T));

 public:
  BatchRays(const RayQuery& query, std::size_t block_rows, api::BatchReport* report)
      : query_(query),
        report_(report),
        block_rows_(std::min(block_rows, query.rays.size())),
        copies_(query.rays.blocks() == nullptr ? block_rows_ : 0) {}

  /// f(rays, number of the first) for every block; stops at the first problem. Calls
  /// have_read(rows) when the first `rows` rows of the table will not be read again.
  template <class F, class HaveRead>
  api::Check ForEach(const F& f, const HaveRead& have_read) {
    const api::RayBlocks* const blocks = query_.rays.blocks();
    if (blocks != nullptr) report_->invalid = blocks->invalid;
    for (std::size_t first = 0; first < query_.rays.size();) {
      std::span<const core::RayOf<T>> rays;
      if (blocks != nullptr) {
        rays = InPlace(first);
      } else {
        rays = copies_.first(std::min(block_rows_, query_.rays.size() - first));
        const auto read = [&] { return Read(first, rays.size()); };
        if (auto problem = Timed(&report_->parse_ms, read)) return problem;
        have_read(first + rays.size());
      }
      if (auto problem = f(rays, first)) return problem;
      first += rays.size();
      if (blocks != nullptr) have_read(first);
    }
    return std::nullopt;
  }

 private:
  std::span<const core::RayOf<T>> InPlace(std::size_t first_row) const {
    const std::span<const char> bytes = query_.rays.InBlock(first_row);
    const std::size_t rows = std::min(block_rows_, bytes.size() / sizeof(core::RayOf<T>));
    return {reinterpret_cast<const core::RayOf<T>*>(bytes.data()), rows};
  }

  // Reads rows and lists the invalid ones.
  api::Check Read(std::size_t first_row, std::size_t count) {
    const std::span<core::RayOf<T>> rays = copies_.first(count);
    std::vector<std::uint64_t>& invalid = report_->invalid;
    const std::size_t invalid_before = invalid.size();
    std::mutex mutex;
    auto problem = ForEachPiece(
        count, kReadRows, query_.trace.cancel, [&](std::size_t first, std::size_t last) {
          const std::span<core::RayOf<T>> piece = rays.subspan(first, last - first);
          query_.rays.Read(first_row + first, std::span(reinterpret_cast<T*>(piece.data()),
                                                        piece.size() * api::kRayNumbers));
          for (const core::RayOf<T>& ray : piece) {
            if (core::IsValid(ray)) [[likely]]
              continue;
            const std::lock_guard lock(mutex);
            invalid.push_back(first_row + first + static_cast<std::size_t>(&ray - piece.data()));
          }
        });
    std::sort(invalid.begin() + static_cast<std::ptrdiff_t>(invalid_before), invalid.end());
    return problem;
  }

  const RayQuery& query_;
  api::BatchReport* report_;
  const std::size_t block_rows_;
  RawArray<core::RayOf<T>> copies_;
};

/// f(rays, number of the first), rays a std::span<const core::RayOf<T>>, for every block of the
/// batch; tells the sink what has been read.
template <class Rows, class F>
api::Check ForEachBlock(const RayQuery& query, std::size_t block_rows, api::RowSink<Rows>* sink,
                        api::BatchReport* report, const F& f) {
  const auto have_read = [sink](std::size_t rows) { sink->HaveRead(rows); };
  if (query.rays.row_type() == api::NumberType::kF4) {
    return BatchRays<float>(query, block_rows, report).ForEach(f, have_read);
  }
  return BatchRays<double>(query, block_rows, report).ForEach(f, have_read);
}

/// The queries with one element per row: `trace(batch, options, elements)` fills a block of
/// Elements, and put(rays, first row, elements, first, last) gives some of them to the sink: at
/// once, by the thread that traced them, while they are in its cache.
template <class Element, class Rows, class Trace, class Put>
api::Check AnswerRows(const RayQuery& query, api::RowSink<Rows>* sink, api::BatchReport* report,
                      const Trace& trace, const Put& put) {
  RawArray<Element> elements(std::min(kBlockRays, query.rays.size()));
  return ForEachBlock(query, kBlockRays, sink, report, [&](auto rays, std::size_t first_row) {
    if (auto problem = sink->Begin(rays.size())) return problem;
    const std::span<Element> block = elements.first(rays.size());
    std::atomic<Clock::rep> put_time{0};  // of all threads
    core::TraceOptions options = query.trace;
    options.traced = [&](std::size_t first, std::size_t last) {
      if (options.cancel.ShouldStop()) return;
      const auto start = Clock::now();
      put(core::RayBatch(rays), first_row, std::span<const Element>(block), first, last);
      put_time += (Clock::now() - start).count();
    };
    double ms = 0;
    const core::Status traced =
        Timed(&ms, [&] { return trace(core::RayBatch(rays), options, block); });
    // Elapsed time, if the threads shared the work evenly.
    const std::size_t threads = std::min(query.threads, (rays.size() - 1) / core::kTracedRows + 1);
    const double put_ms =
        std::chrono::duration<double, std::milli>(Clock::duration(put_time)).count() /
        static_cast<double>(threads);
    report->encode_ms += put_ms;
    report->trace_ms += ms - put_ms;
    return ToCheck(traced);
  });
}

/// The hits of a block of `all`, given to the sink in pieces.
class BlockOfAll {
 public:
  BlockOfAll(const RayQuery& query, const core::AllHits& all, core::RayBatch rays,
             std::size_t first_row, std::size_t first_hit)
      : query_(query), all_(all), rays_(rays), first_row_(first_row), first_hit_(first_hit) {
    // Pieces end after some rows or some hits.
    starts_ = {0};
    for (std::size_t row = 0; row < rays_.size(); ++row) {
      if (row + 1 - starts_.back() >= kPutRows ||
          all_.first[row + 1] - all_.first[starts_.back()] >= kPutHits) {
        starts_.push_back(row + 1);
      }
    }
    if (starts_.back() != rays_.size()) starts_.push_back(rays_.size());
  }

  api::Check Put(api::RowSink<api::AllRows>* sink) const {
    if (auto problem = sink->Begin(all_.hits.size())) return problem;
    return ForEachPiece(starts_.size() - 1, 1, query_.trace.cancel,
                        [&](std::size_t piece, std::size_t) { PutPiece(piece, sink); });
  }

 private:
  void PutPiece(std::size_t piece, api::RowSink<api::AllRows>* sink) const {
    const std::size_t row = starts_[piece], last = starts_[piece + 1];
    std::vector<std::uint32_t> counts;
    std::vector<std::size_t> row_of_hit;
    for (std::size_t i = row; i < last; ++i) {
      counts.push_back(static_cast<std::uint32_t>(all_.first[i + 1] - all_.first[i]));
      row_of_hit.insert(row_of_hit.end(), counts.back(), i);
    }
    const std::size_t hit = all_.first[row];
    HitDetails details(query_.scene, query_.attributes, query_.options);
    const api::Hits hits = details.Fill(std::span(all_.hits).subspan(hit, row_of_hit.size()),
                                        [&](std::size_t i) { return rays_[row_of_hit[i]]; });
    sink->Put({.first_row = first_row_ + row,
               .first_hit = first_hit_ + hit,
               .counts = counts,
               .hits = hits});
  }

  const RayQuery& query_;
  const core::AllHits& all_;
  const core::RayBatch rays_;
  const std::size_t first_row_, first_hit_;
  std::vector<std::size_t> starts_;  ///< the first row of each piece, and the end
};

api::Problem TooManyHits(std::uint64_t most_hits) {
  return {.code = api::ErrorCode::kTooManyHits,
          .detail = "the answer has more than " + std::to_string(most_hits) +
                    " hits; send fewer rows, or a smaller max_hits",
          .limit = static_cast<double>(most_hits)};
}

}  // namespace

api::Check AnswerClosest(const RayQuery& query, api::RowSink<api::ClosestRows>* sink,
                         api::BatchReport* report) {
  return AnswerRows<core::Hit>(
      query, sink, report,
      [&](const core::RayBatch& rays, const core::TraceOptions& options,
          std::span<core::Hit> hits) {
        return core::TraceClosest(query.scene, rays, options, hits);
      },
      [&](const core::RayBatch& rays, std::size_t first_row, std::span<const core::Hit> hits,
          std::size_t first, std::size_t last) {
        HitDetails details(query.scene, query.attributes, query.options);
        for (; first < last; first += kPutRows) {
          sink->Put({.first_row = first_row + first,
                     .hits = details.Fill(hits.subspan(first, std::min(kPutRows, last - first)),
                                          [&](std::size_t i) { return rays[first + i]; })});
        }
      });
}

api::Check AnswerAny(const RayQuery& query, api::RowSink<api::AnyRows>* sink,
                     api::BatchReport* report) {
  return AnswerRows<std::uint8_t>(
      query, sink, report,
      [&](const core::RayBatch& rays, const core::TraceOptions& options,
          std::span<std::uint8_t> occluded) {
        return core::TraceAny(query.scene, rays, options, occluded);
      },
      [&](const core::RayBatch&, std::size_t first_row, std::span<const std::uint8_t> occluded,
          std::size_t first, std::size_t last) {
        sink->Put(
            {.first_row = first_row + first, .occluded = occluded.subspan(first, last - first)});
      });
}

api::Check AnswerCount(const RayQuery& query, api::RowSink<api::CountRows>* sink,
                       api::BatchReport* report) {
  return AnswerRows<std::uint32_t>(
      query, sink, report,
      [&](const core::RayBatch& rays, const core::TraceOptions& options,
          std::span<std::uint32_t> counts) {
        return core::TraceCount(query.scene, rays, options, counts);
      },
      [&](const core::RayBatch&, std::size_t first_row, std::span<const std::uint32_t> counts,
          std::size_t first, std::size_t last) {
        sink->Put({.first_row = first_row + first, .counts = counts.subspan(first, last - first)});
      });
}

api::Check AnswerAll(const RayQuery& query, std::uint64_t most_hits,
                     api::RowSink<api::AllRows>* sink, api::BatchReport* report) {
  const auto max_hits = static_cast<std::size_t>(query.options.max_hits);
  const std::size_t block_rows = std::clamp(kBlockHits / max_hits, std::size_t{1}, kBlockRays);
  std::size_t hits_before = 0;
  return ForEachBlock(query, block_rows, sink, report, [&](auto rays, std::size_t first_row) {
    const core::RayBatch batch(rays);
    const core::Result<core::AllHits> all = Timed(&report->trace_ms, [&] {
      return core::TraceAll(query.scene, batch, query.trace, max_hits,
                            static_cast<std::size_t>(most_hits) - hits_before);
    });
    if (!all.ok()) return api::Check(ToProblem(all.error()));
    if (all->too_many) return api::Check(TooManyHits(most_hits));
    for (const std::size_t row : all->truncated) report->truncated.push_back(first_row + row);
    return Timed(&report->encode_ms, [&] {
      const BlockOfAll block(query, *all, batch, first_row, hits_before);
      hits_before += all->hits.size();
      return block.Put(sink);
    });
  });
}

}  // namespace kdray::server
