// Which trees there are: one small file each, named by the id, so that a crash or a damaged file
// touches one tree and no other.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "core/base/result.h"
#include "core/scene/prepared_mesh.h"
#include "core/scene/tree_id.h"
#include "core/store/blob_store.h"

namespace kdray::core {

/// What is known about a tree without its mesh and structure in memory: enough to describe it.
struct TreeRecord {
  TreeId id;
  std::int64_t created_ms = 0;    ///< since 1970, UTC
  std::uint64_t mesh_bytes = 0;   ///< size of the mesh file
  std::optional<MeshFacts> mesh;  ///< once it was parsed
  std::optional<TreeFacts> tree;  ///< once it was built; without it a build is due
  friend bool operator==(const TreeRecord&, const TreeRecord&) = default;
};

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
