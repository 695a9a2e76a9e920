// Which trees there are: one small file each, named by the id, so that a crash or a damaged file
// touches one tree and no other.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "core/base/result.h"
#include "core/catalog/records.h"
#include "core/catalog/tree_id.h"
#include "core/store/blob_store.h"

namespace kdray::core {

/// Safe from many threads at once; not for two calls about one id at the same time.
class Catalog {
 public:
  Catalog(FileSystem* file_system, std::filesystem::path directory)
      : blobs_(file_system, std::move(directory)) {}

  Status Open() { return blobs_.Open(); }

  struct Contents {
    std::vector<TreeRecord> records;  ///< in no order
    std::uint64_t damaged = 0;        ///< of them, those whose file is no record
    std::uint64_t unreadable = 0;     ///< of the damaged, those that cannot be read at all
  };
  /// All records. A file that cannot be read still tells by its name that the tree was wanted: its
  /// record has the file's time and a build due. Names that are no tree id
  /// are passed over.
  /// Fails only when the folder cannot be listed.
  Result<Contents> Load() const;

  /// Durable when it returns; after an error the old record or the new one is there.
  Status Save(const TreeRecord& record);
  /// Durable when it returns; after an error the record may be there, or come back.
  Status Remove(const TreeId& id);
  /// Remove for every id that the mesh can have.
  Status RemoveAllOf(const Sha256Digest& mesh);
  /// Whether there is a file of this name now, sound or not.
  bool Has(const TreeId& id) const { return blobs_.Read(id.ToString()).ok(); }

 private:
  Result<TreeRecord> Read(const TreeId& id) const;

  BlobStore blobs_;
};

}  // namespace kdray::core
