// What the HTTP side needs of core, so that routes, handlers and their status codes are tested with
// a fake and no mesh (tests/support/fake_backend.h). CoreBackend (server/core_backend.h) is the
// real one. The types are those of the contract (api/types.h).
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "api/types.h"
#include "core/base/cancel.h"

namespace kdray::server {

/// Deadline of the request and departure of its client, in one.
using core::CancelToken;

/// A mesh on its way in: hashed and written to a temporary file while it arrives. Destroyed
/// unfinished, it leaves nothing behind.
class MeshUpload {
 public:
  virtual ~MeshUpload() = default;
  /// store_full when the disk refuses.
  virtual api::Check Append(std::span<const std::byte> bytes) = 0;

  struct Stored {
    std::string id;
    bool existed = false;  ///< this id was there before
  };
  /// The mesh is on disk for good (fsync) and its build is under way or done when this returns; see
  /// WaitUntilBuilt. empty_mesh for no bytes. Call once.
  virtual api::Outcome<Stored> Finish(api::Build build) = 0;
};

/// A mesh's original bytes, readable while held even if the tree is deleted meanwhile.
class MeshBytes {
 public:
  virtual ~MeshBytes() = default;
  virtual std::uint64_t size() const = 0;
  /// Fills `out` from `offset`; false when the disk fails.
  virtual bool Read(std::uint64_t offset, std::span<std::byte> out) const = 0;
};

/// A tree that is built and in memory, for as long as the handle lives. Methods are safe from many
/// threads at once, block, and end early when their `cancel` says so: deadline_exceeded.
class LoadedTree {
 public:
  virtual ~LoadedTree() = default;
  virtual api::Outcome<api::ClosestAnswer> Closest(const api::RayTable& rays,
                                                   const api::RayOptions& options,
                                                   const CancelToken& cancel) const = 0;
  virtual api::Outcome<api::AnyAnswer> Any(const api::RayTable& rays,
                                           const api::RayOptions& options,
                                           const CancelToken& cancel) const = 0;
  /// `png`: PNG bytes, else the array. invalid_parameter for an impossible camera (eye equal to
  /// target, …).
  virtual api::Outcome<api::RenderAnswer> Render(const api::RenderRequest& request, bool png,
                                                 const CancelToken& cancel) const = 0;
  /// too_many_cells beyond limits.max_cells.
  virtual api::Outcome<std::vector<api::Cell>> Cells(std::uint32_t depth,
                                                     const CancelToken& cancel) const = 0;
};

/// What a request does with a tree.
enum class TreeUse : std::uint8_t {
  kRays,   ///< queries, and renders without cells
  kCells,  ///< the cells themselves, or a render that shows them
};

/// Every method is safe from many threads at once and may block the calling thread; none throws on
/// purpose. A tree whose build failed answers with the problem of the build for 10 minutes
/// (invalid_mesh, empty_mesh, …), an unknown id with tree_not_found.
class Backend {
 public:
  virtual ~Backend() = default;

  /// Starts an upload of `size` bytes: mesh_too_large, store_full or memory_full before the first
  /// byte.
  virtual api::Outcome<std::unique_ptr<MeshUpload>> BeginUpload(std::uint64_t size) = 0;
  /// Another build of a stored mesh: mesh_not_found.
  virtual api::Outcome<MeshUpload::Stored> BuildStored(std::string_view sha256,
                                                       api::Build build) = 0;

  /// The problem that the tree has, if any. Neither waits nor describes.
  virtual api::Check Find(std::string_view id) = 0;
  /// Waits until the tree is built, fails, is deleted, or `until` or `cancel` comes; then describes
  /// it (state building when time ran out).
  virtual api::Outcome<api::TreeDescription> Describe(std::string_view id,
                                                      std::chrono::steady_clock::time_point until,
                                                      const CancelToken& cancel) = 0;
  /// Waits until the tree is built and in memory. tree_building when the deadline of `cancel` comes
  /// before the tree is built, deadline_exceeded when it was only to be read in again. The handle
  /// must not outlive the backend.
  virtual api::Outcome<std::unique_ptr<const LoadedTree>> Acquire(std::string_view id, TreeUse use,
                                                                  const CancelToken& cancel) = 0;
  /// Newest first; `mesh` empty or a sha256; `after` empty or a cursor (invalid_parameter when it
  /// is not one).
  virtual api::Outcome<api::TreePage> List(std::string_view mesh, std::size_t limit,
                                           std::string_view after) = 0;
  /// A running build stops; the mesh goes with its last tree.
  virtual api::Check Delete(std::string_view id) = 0;
  /// Checks all of its bytes first, as long as `cancel` lets it.
  virtual api::Outcome<std::unique_ptr<MeshBytes>> OpenMesh(std::string_view id,
                                                            const CancelToken& cancel) = 0;

  /// Begins to measure speed and accuracy on the mesh, in the background, unless that is under way.
  virtual api::Check Measure(std::string_view id) = 0;
  /// What was measured, or how far it is; waits until it has ended, or `until` or `cancel` comes.
  /// not_measured; the problem of a measurement that failed.
  virtual api::Outcome<api::Tradeoff> WaitForTradeoff(std::string_view id,
                                                      std::chrono::steady_clock::time_point until,
                                                      const CancelToken& cancel) = 0;
  /// Stops a measurement and forgets what was measured: not_measured when there is neither.
  virtual api::Check ForgetTradeoff(std::string_view id) = 0;

  /// Stops builds and waits for them; a build cut off here resumes at the next start. Queries under
  /// way finish.
  virtual void Shutdown() = 0;
};

}  // namespace kdray::server
