// SPDX-License-Identifier: Apache-2.0
// The interface between handlers and core, so routes, handlers and their status codes are tested
// with a fake (tests/support/fake_backend.h) and without meshes. CoreBackend
// (server/core_backend.h) is the real backend. The types are the contract's (api/types.h).
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "api/points.h"
#include "api/ray_table.h"
#include "api/row_sink.h"
#include "api/types.h"
#include "api/visibility.h"
#include "core/base/cancel.h"
#include "core/library/memory_budget.h"

namespace kdray::server {

/// Stops at the request's deadline or when its client leaves.
using core::CancelToken;

/// An unfinished upload: hashed and written to a temporary file while it arrives. The destructor
/// removes an unfinished one.
class MeshUpload {
 public:
  virtual ~MeshUpload() = default;
  /// store_full if the disk is full.
  virtual api::Check Append(std::span<const std::byte> bytes) = 0;

  struct Stored {
    std::string id;
    bool existed = false;  ///< this id existed before
  };
  /// When this returns, the mesh is durable on disk (fsync), and its build is running or done; see
  /// WaitUntilBuilt. empty_mesh without bytes. Call once.
  virtual api::Outcome<Stored> Finish(api::Build build) = 0;
};

/// A mesh's original bytes; readable even if the tree is deleted meanwhile.
class MeshBytes {
 public:
  virtual ~MeshBytes() = default;
  virtual std::uint64_t size() const = 0;
  /// Fills `out` from `offset`; false if the disk fails. For one thread at a time.
  virtual bool Read(std::uint64_t offset, std::span<std::byte> out) const = 0;
};

/// A built tree, kept in memory during the handle's lifetime. Methods are safe from many threads at
/// once, block, and end early with deadline_exceeded when their `cancel` stops.
class LoadedTree {
 public:
  virtual ~LoadedTree() = default;

  /// Memory that stays in use as long as this object lives.
  virtual std::uint64_t bytes() const = 0;

  // Ray queries. `sink` gets the rows, in order and in blocks; the report has the rest of the
  // answer. The problem may be the sink's.
  virtual api::Outcome<api::BatchReport> Closest(const api::RayTable& rays,
                                                 const api::RayOptions& options,
                                                 const CancelToken& cancel,
                                                 api::RowSink<api::ClosestRows>* sink) const = 0;
  virtual api::Outcome<api::BatchReport> Any(const api::RayTable& rays,
                                             const api::RayOptions& options,
                                             const CancelToken& cancel,
                                             api::RowSink<api::AnyRows>* sink) const = 0;
  virtual api::Outcome<api::BatchReport> Count(const api::RayTable& rays,
                                               const api::RayOptions& options,
                                               const CancelToken& cancel,
                                               api::RowSink<api::CountRows>* sink) const = 0;
  /// too_many_hits beyond limits.MaxAnswerHits().
  virtual api::Outcome<api::BatchReport> All(const api::RayTable& rays,
                                             const api::RayOptions& options,
                                             const CancelToken& cancel,
                                             api::RowSink<api::AllRows>* sink) const = 0;

  /// Calls piece(0) to piece(count - 1) on the threads that compute, and waits for all.
  virtual void RunPieces(std::size_t count,
                         const std::function<void(std::size_t)>& piece) const = 0;

  // Point queries. `put` gets the rows in order, block by block, at least once.

  template <class Row>
  using PutRows = std::function<void(std::span<const Row>)>;

  virtual api::Outcome<api::PointReport> ClosestPoints(
      const api::PointTable& points, const api::PointOptions& options, const CancelToken& cancel,
      const PutRows<api::NearestPoint>& put) const = 0;
  /// NaN where the sign is unknown.
  virtual api::Outcome<api::PointReport> SignedDistances(const api::PointTable& points,
                                                         const api::PointOptions& options,
                                                         const CancelToken& cancel,
                                                         const PutRows<double>& put) const = 0;
  /// 1, 0, or -1 for unknown.
  virtual api::Outcome<api::PointReport> Inside(const api::PointTable& points,
                                                const api::PointOptions& options,
                                                const CancelToken& cancel,
                                                const PutRows<std::int8_t>& put) const = 0;

  virtual api::Outcome<api::VisibilityAnswer> Visibility(const api::PointSets& sets,
                                                         const api::VisibilityOptions& options,
                                                         const CancelToken& cancel) const = 0;

  /// `png`: PNG bytes, else the array. invalid_parameter for an invalid camera (eye equal to
  /// target, …).
  virtual api::Outcome<api::RenderAnswer> Render(const api::RenderRequest& request, bool png,
                                                 const CancelToken& cancel) const = 0;
  /// too_many_cells beyond limits.max_cells.
  virtual api::Outcome<std::vector<api::Cell>> Cells(std::uint32_t depth,
                                                     const CancelToken& cancel) const = 0;
};

/// The use of a tree by a request.
enum class TreeUse : std::uint8_t {
  kRays,   ///< queries of rays and points, and renders without cells
  kCells,  ///< lists of cells, and renders that show them or the cost
};

/// Counts of the store that replicas share (--store), since the start.
struct SharedStoreCounters {
  struct Requests {
    std::string_view operation;  ///< list, head, get, put, delete
    std::uint64_t answered = 0;
    std::uint64_t failed = 0;  ///< no answer, a refusal, or an altered answer
  };
  struct TimeClass {
    double most_seconds = 0;     ///< infinite for the last class
    std::uint64_t requests = 0;  ///< those of the classes before included
  };
  struct Files {
    std::uint64_t here = 0;     ///< found in the data directory
    std::uint64_t fetched = 0;  ///< from the store
  };
  std::vector<Requests> requests;  ///< each attempt of a call
  std::vector<TimeClass> times;
  double seconds = 0;         ///< the sum of their times
  std::uint64_t retries = 0;  ///< attempts after a call's first one
  std::uint64_t sent_bytes = 0, received_bytes = 0;
  std::uint64_t lookups = 0;  ///< questions whether a tree exists
  Files meshes, trees;        ///< that requests and builds needed
  bool is_away = false;       ///< now
};

/// Counts of the backend's work since its start, and of what it holds. For metrics and tests.
struct BackendCounters {
  std::uint64_t parses = 0;             ///< mesh files read
  std::uint64_t builds = 0;             ///< trees built, rebuilt ones included
  std::uint64_t loads = 0;              ///< trees read from disk instead of built
  std::uint64_t cache_hits = 0;         ///< trees that requests found in memory
  std::uint64_t rebuilds = 0;           ///< builds of trees that were ready before
  std::uint64_t damaged_files = 0;      ///< stored files that failed their check
  std::uint64_t evictions = 0;          ///< meshes and trees dropped from memory
  std::uint64_t memory_bytes = 0;       ///< reserved now, of memory_limit_bytes
  std::uint64_t store_bytes = 0;        ///< on disk now
  std::uint64_t trees = 0;              ///< current ids
  std::uint64_t unrecorded_meshes = 0;  ///< on disk without a tree, kept until uploaded again
  std::uint64_t unreadable_meshes = 0;  ///< meshes of trees, damaged or missing and not repaired
  std::uint64_t binary_rebuilds = 0;    ///< binary trees rebuilt for cells
  std::uint64_t attribute_reads = 0;    ///< mesh files read for their attributes
  std::uint64_t memory_limit_bytes = 0;
  std::optional<std::uint64_t> store_limit_bytes;  ///< nullopt: as much as the disk holds
  std::optional<std::uint64_t> store_free_bytes;   ///< of the disk; nullopt if it does not say
  std::optional<SharedStoreCounters> shared;       ///< nullopt without a shared store
};

/// Every method is safe from many threads at once and may block the calling thread; none throws on
/// purpose. Methods that take an id return tree_not_found for an unknown id, and for 10 minutes the
/// problem of a failed build (invalid_mesh, empty_mesh, …).
class Backend {
 public:
  virtual ~Backend() = default;

  /// Starts an upload of at least `size` bytes: mesh_too_large, store_full or memory_full before
  /// the first byte. The size of a compressed or chunked upload is not known before its end.
  virtual api::Outcome<std::unique_ptr<MeshUpload>> BeginUpload(std::uint64_t size) = 0;
  /// Another build of a stored mesh: mesh_not_found.
  virtual api::Outcome<MeshUpload::Stored> BuildStored(std::string_view sha256,
                                                       api::Build build) = 0;

  /// The tree's problem, if any. Does not wait.
  virtual api::Check Find(std::string_view id) = 0;
  /// Waits until the tree is built, fails or is deleted, or until `until` or `cancel`; then
  /// describes it (state building after a timeout).
  virtual api::Outcome<api::TreeDescription> Describe(std::string_view id,
                                                      std::chrono::steady_clock::time_point until,
                                                      const CancelToken& cancel) = 0;
  /// Waits until the tree is built and in memory. If the deadline of `cancel` comes first:
  /// tree_building before the tree is built, deadline_exceeded while it is loaded again. The handle
  /// must not outlive the backend.
  virtual api::Outcome<std::unique_ptr<const LoadedTree>> Acquire(std::string_view id, TreeUse use,
                                                                  const CancelToken& cancel) = 0;
  /// Newest first; `mesh` is empty or a sha256; `after` is empty or a cursor (invalid_parameter for
  /// another text).
  virtual api::Outcome<api::TreePage> List(std::string_view mesh, std::size_t limit,
                                           std::string_view after) = 0;
  /// A running build stops; the mesh is deleted with its last tree.
  virtual api::Check Delete(std::string_view id) = 0;
  /// Checks all of its bytes, unless the file is unchanged since it was checked, as long as
  /// `cancel` lets it.
  virtual api::Outcome<std::unique_ptr<MeshBytes>> OpenMesh(std::string_view id,
                                                            const CancelToken& cancel) = 0;

  /// Starts measuring speed and accuracy on the mesh in the background, unless a measurement is
  /// running.
  virtual api::Check Measure(std::string_view id) = 0;
  /// The result or the progress of the measurement; waits until its end, `until` or `cancel`.
  /// not_measured; the problem of a failed measurement.
  virtual api::Outcome<api::Tradeoff> WaitForTradeoff(std::string_view id,
                                                      std::chrono::steady_clock::time_point until,
                                                      const CancelToken& cancel) = 0;
  /// Stops a measurement and deletes the result: not_measured if there is neither.
  virtual api::Check ForgetTradeoff(std::string_view id) = 0;

  virtual BackendCounters counters() const = 0;
  /// The budget of meshes, trees and builds; null if there is none.
  virtual core::MemoryBudget* memory() { return nullptr; }

  /// Stops builds and waits for them; they resume at the next start. Running queries finish.
  virtual void Shutdown() = 0;
};

}  // namespace kdray::server
