// SPDX-License-Identifier: Apache-2.0
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
#include "core/library/shared_trees.h"
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
  core::SharedTreesOptions shared;          ///< the store that replicas share, if any
  core::FileSystem* file_system = nullptr;  ///< for tests; null: the operating system's
};

/// Takes the data directory, reads in what it holds and resumes builds that were cut off. Errors,
/// each with a message for the operator: kInvalidArgument (an option out of range, another daemon
/// uses the directory), kIo, kStoreFull (the directory cannot be made or read, or the shared store
/// refuses).
core::Result<std::unique_ptr<Backend>> MakeCoreBackend(CoreBackendOptions options);

}  // namespace kdray::server
