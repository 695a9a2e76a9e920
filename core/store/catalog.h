// SPDX-License-Identifier: Apache-2.0
// The records of trees: one small file for each, named by the id, so a crash or a damaged file
// affects only one tree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "core/base/result.h"
#include "core/catalog/records.h"
#include "core/catalog/tree_id.h"
#include "core/store/blob_store.h"

namespace kdray::core {

/// The bytes of a record's file.
std::vector<std::byte> EncodeRecord(const TreeRecord& record);
/// kCorrupt unless they are valid and of this id.
Result<TreeRecord> DecodeRecord(const TreeId& id, std::vector<std::byte> bytes);

/// Safe from many threads at once; not for two calls about one id at the same time.
class Catalog {
 public:
  Catalog(FileSystem* file_system, std::filesystem::path directory)
      : blobs_(file_system, std::move(directory)) {}

  Status Open() { return blobs_.Open(); }

  struct Contents {
    std::vector<TreeRecord> records;  ///< in no order
    std::uint64_t damaged = 0;        ///< those of them whose file is not a valid record
    std::uint64_t unreadable = 0;     ///< of the damaged, those that cannot be read at all
  };
  /// All records. A file that cannot be read still names its tree: its record has the file's time,
  /// and a build is due. Names that are not tree ids are skipped. Fails only if the folder cannot
  /// be listed.
  Result<Contents> Load() const;

  /// Durable when it returns; after an error the old or the new record exists.
  Status Save(const TreeRecord& record);
  /// Durable when it returns; after an error the record may exist, or reappear.
  Status Remove(const TreeId& id);
  /// The names of a mesh's groups, in a file beside the records. Durable when it returns.
  Status SaveGroupNames(const Sha256Digest& mesh, std::span<const std::string> names);
  /// kNotFound if they were not saved; kCorrupt.
  Result<std::vector<std::string>> ReadGroupNames(const Sha256Digest& mesh) const;

  /// Remove for every id that the mesh can have, and its groups.
  Status RemoveAllOf(const Sha256Digest& mesh);
  /// Whether a file of this name exists, valid or not.
  bool Has(const TreeId& id) const { return blobs_.Read(id.ToString()).ok(); }

 private:
  Result<TreeRecord> Read(const TreeId& id) const;

  BlobStore blobs_;
};

}  // namespace kdray::core
