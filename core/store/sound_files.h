// SPDX-License-Identifier: Apache-2.0
// Mesh files whose bytes were checked and have not been changed since, so a file is not hashed for
// every request.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "core/base/hash.h"
#include "core/store/file_system.h"

namespace kdray::core {

/// The system notes the time of each change of a file, so an unchanged one needs no second check
/// before it is read. What changes without the system, as a failing disk, is found while the bytes
/// are read. Safe from many threads at once.
class SoundFiles {
 public:
  /// Whether Note() was called for this mesh with the same version of its file. False without a
  /// version.
  bool Has(const Sha256Digest& mesh, const std::optional<FileVersion>& version) const;
  /// The file has the mesh's hash.
  void Note(const Sha256Digest& mesh, const std::optional<FileVersion>& version);
  void Forget(const Sha256Digest& mesh);

  /// `file`, which must have been noted, hashed while it is read from front to back: the read that
  /// ends at its end is kCorrupt if the bytes have another hash, and the mesh is forgotten. Other
  /// orders of reading are not checked. For one thread at a time; must not outlive this object.
  std::unique_ptr<ReadableFile> HashWhileRead(std::unique_ptr<ReadableFile> file,
                                              const Sha256Digest& mesh);

 private:
  class HashedFile;

  mutable std::mutex mutex_;
  std::map<Sha256Digest, FileVersion> versions_;
};

}  // namespace kdray::core
