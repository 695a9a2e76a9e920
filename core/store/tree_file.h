// SPDX-License-Identifier: Apache-2.0
// A built tree on disk, so a restart reads it instead of building it. Derived from the mesh: if
// damaged or lost, it is built again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "core/accel/tree.h"
#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/store/blob_store.h"

namespace kdray::core {

/// A file is only read if it has this revision. Increment it when a change of a builder gives other
/// trees, so stored ones are rebuilt.
inline constexpr std::uint32_t kBuilderRevision = 6;

/// Identifies the tree of a file.
struct TreeFileKey {
  Sha256Digest mesh;               ///< of the mesh file's bytes
  std::size_t triangle_count = 0;  ///< of the mesh
  BuildKind build = BuildKind::kBox;
};

/// Writes everything; the result only needs its name (NewBlob::Commit). Errors: those of
/// FileSystem, kCancelled, kDeadlineExceeded.
Result<NewBlob> WriteTreeFile(const TreeFileKey& key, const Tree& tree, NewBlob blob,
                              const CancelToken& cancel = {});

/// The same tree, bit for bit, and safe to traverse (Validate). kCorrupt for a file that is
/// damaged, of another version, byte order or builder revision, or another tree's; kCancelled,
/// kDeadlineExceeded.
Result<Tree> ReadTreeFile(const TreeFileKey& key, std::unique_ptr<ReadableFile> file,
                          const CancelToken& cancel = {});

}  // namespace kdray::core
