// A built tree on disk, so that a restart reads it instead of building. Derived from the mesh: a
// damaged or lost one is built again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "core/accel/tree.h"
#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/store/blob_store.h"

namespace kdray::core {

/// Part of what a file must match to be taken. Raise it when a builder is changed so that it makes
/// other trees: stored ones then give way to what this version builds.
inline constexpr std::uint32_t kBuilderRevision = 6;

/// Which tree a file holds.
struct TreeFileKey {
  Sha256Digest mesh;               ///< of the mesh file's bytes
  std::size_t triangle_count = 0;  ///< of the mesh
  BuildKind build = BuildKind::kBox;
};

/// Writes everything; what comes back has only to be named (NewBlob::Commit). Errors: those of
/// FileSystem.
Result<NewBlob> WriteTreeFile(const TreeFileKey& key, const Tree& tree, NewBlob blob);

/// The same tree, bit for bit, and safe to traverse (Validate). kCorrupt for a file that is
/// damaged, of another version, byte order or builder revision, or another tree's.
Result<Tree> ReadTreeFile(const TreeFileKey& key, std::unique_ptr<ReadableFile> file);

}  // namespace kdray::core
