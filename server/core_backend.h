// The real backend: keeps meshes and trees with core's TreeLibrary and answers queries with core's
// tracer and renderer. It parses ids, runs work in the query arena, and converts types with
// server/mapping.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "api/limits.h"
#include "core/base/result.h"
#include "server/backend.h"

namespace kdray::core {
class FileSystem;
}

namespace kdray::server {

struct CoreBackendOptions {
  std::filesystem::path data_dir;  ///< made when it is not there
  int threads = 1;                 ///< for queries, and as many again for builds; >= 1
  std::uint64_t memory_limit_bytes = std::uint64_t{4} << 30;  ///< meshes, trees and builds together
  std::optional<std::uint64_t> store_limit_bytes;             ///< none: as much as the disk holds
  api::Limits limits;
  core::FileSystem* file_system = nullptr;  ///< for tests; null: the operating system's
};

/// Counts of the backend's work since its start, and of what it holds. For metrics and tests.
struct BackendCounters {
  std::uint64_t parses = 0;             ///< mesh files read
  std::uint64_t builds = 0;             ///< trees built, rebuilt ones included
  std::uint64_t loads = 0;              ///< trees read from disk instead of built
  std::uint64_t rebuilds = 0;           ///< builds of trees that were ready before
  std::uint64_t damaged_files = 0;      ///< stored files that failed their check
  std::uint64_t evictions = 0;          ///< meshes and trees dropped from memory
  std::uint64_t memory_bytes = 0;       ///< reserved now, of memory_limit_bytes
  std::uint64_t store_bytes = 0;        ///< on disk now
  std::uint64_t trees = 0;              ///< current ids
  std::uint64_t unrecorded_meshes = 0;  ///< on disk without a tree, kept until uploaded again
  std::uint64_t unreadable_meshes = 0;  ///< meshes of trees, damaged or missing and not repaired
  std::uint64_t binary_rebuilds = 0;    ///< binary trees rebuilt for cells
};

class CoreBackend : public Backend {
 public:
  virtual BackendCounters counters() const = 0;
};

/// Takes the data directory, reads in what it holds and resumes builds that were cut off. Errors,
/// each with a message for the operator: kInvalidArgument (an option out of range, another daemon
/// uses the directory), kIo, kStoreFull (the directory cannot be made or read).
core::Result<std::unique_ptr<CoreBackend>> MakeCoreBackend(CoreBackendOptions options);

}  // namespace kdray::server
