// SPDX-License-Identifier: Apache-2.0
// Trees and meshes that several libraries share through an object store. Its objects:
//   catalog/<id>/<generation>          the record of a tree
//   catalog/<id>/<generation>-deleted  empty: the tree of this generation was deleted
//   meshes/<sha256>/<generation>       the bytes of its mesh
//   by-age/<time>/<id>/<generation>    empty: trees in the order of lists, newest first
//   trees/<revision>/<sha256>-<build>  derived: the built tree (tree_file.h)
// core/library/shared_trees.h uses them, with the data directory as a cache.
//
// Each upload of an absent id makes a generation: a new name, which begins with the time of the
// store's clock. No name is used twice, so a request that a store carries out late, or twice, can
// neither delete what another replica acknowledged since, nor bring back what was deleted. An id
// exists exactly if it has a generation with a record and without a deletion. A record is written
// after its mesh, so whoever sees the record can read the mesh. Each generation has a copy of the
// mesh of its own, so its deletion takes nothing from another id.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/accel/build_kind.h"
#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/catalog/records.h"
#include "core/catalog/tree_id.h"
#include "core/store/file_system.h"
#include "core/store/object_store.h"

namespace kdray::core {

/// Safe from many threads at once, and beside any number of others on the same objects. Errors of
/// every call: those of ObjectStore.
class SharedStore {
 public:
  using Clock = std::chrono::steady_clock;
  /// Bytes of an object pass through a buffer of the caller.
  static constexpr std::uint64_t kPieceBytes = std::uint64_t{8} << 20;
  /// The size of the buffer for an object: all of it, or kPieceBytes, or more if it has too many
  /// parts otherwise.
  static std::size_t BufferBytes(std::uint64_t object_bytes);

  /// `store` must outlive this.
  explicit SharedStore(ObjectStore* store) : store_(store) {}

  /// Whether the store can be reached and read.
  Status Check(const CancelToken& cancel);

  // Trees.

  /// A tree that exists.
  struct Found {
    TreeRecord record;
    std::string generation;
    Clock::time_point seen;  ///< it existed at a time after this
  };
  /// nullopt if no tree has the id.
  Result<std::optional<Found>> Find(const TreeId& id, const CancelToken& cancel);
  Result<bool> Exists(const TreeId& id, const CancelToken& cancel);
  /// The ids of a mesh, in their order.
  Result<std::vector<TreeId>> IdsOf(const Sha256Digest& mesh, const CancelToken& cancel);

  struct Published : Found {
    bool existed = false;
  };
  /// Makes a tree of record.id, unless it exists; record.created_ms is set. Mesh and record are in
  /// the store when it returns. The bytes of `mesh` must have the hash of the id. After an error
  /// the tree may exist, or appear later.
  Result<Published> Publish(TreeRecord record, const ReadableFile& mesh,
                            std::span<std::byte> buffer, const CancelToken& cancel);
  /// Deletes one generation; success if it was deleted before.
  Status Withdraw(const TreeId& id, const std::string& generation, const CancelToken& cancel);
  /// Deletes all of them. False if no tree has the id.
  Result<bool> Remove(const TreeId& id, const CancelToken& cancel);
  /// Replaces the record of a tree, without created_ms. False, and no effect, if no tree has the
  /// id.
  Result<bool> Update(TreeRecord record, const CancelToken& cancel);

  /// An entry of the list of trees; its tree may have been deleted meanwhile.
  struct Listed {
    std::int64_t created_ms = 0;
    TreeId id;
    std::string generation;
  };
  struct ListedPage {
    std::vector<Listed> trees;  ///< newest first, at equal time by id
    bool has_more = false;
  };
  /// At most `limit` entries after the one of this time and id.
  Result<ListedPage> List(const std::optional<std::pair<std::int64_t, TreeId>>& after,
                          std::size_t limit, const CancelToken& cancel);
  /// The record of a list's entry. kNotFound if the tree was deleted, or another entry stands for
  /// it.
  Result<TreeRecord> ReadRecord(const TreeId& id, const std::string& generation,
                                const CancelToken& cancel);

  // Bytes.

  using Append = std::function<Status(std::span<const std::byte>)>;
  /// Objects that should have the bytes of the mesh, by their names and size.
  Result<std::vector<std::string>> CopiesOf(const Sha256Digest& mesh, std::uint64_t bytes,
                                            const CancelToken& cancel);
  /// Passes the first `bytes` of an object to `append`, piece by piece. Checks no hash.
  Status Read(std::string_view key, std::uint64_t bytes, std::span<std::byte> buffer,
              const Append& append, const CancelToken& cancel);

  static std::string TreeKey(const Sha256Digest& mesh, BuildKind build);
  /// The size of a stored tree; kNotFound.
  Result<std::uint64_t> TreeBytes(const Sha256Digest& mesh, BuildKind build,
                                  const CancelToken& cancel);
  /// As Read, for a file of checked_file.h: kCorrupt if it fails its check. Then it is deleted, so
  /// the next PutTree replaces it.
  Status ReadTree(const Sha256Digest& mesh, BuildKind build, std::uint64_t bytes,
                  std::span<std::byte> buffer, const Append& append, const CancelToken& cancel);
  /// Success if the store has it already.
  Status PutTree(const Sha256Digest& mesh, BuildKind build, const ReadableFile& file,
                 std::span<std::byte> buffer, const CancelToken& cancel);
  /// Deletes the stored trees of a mesh that has no id any more; no effect if that fails.
  void CleanTrees(const Sha256Digest& mesh, const CancelToken& cancel);

 private:
  // A record that exists.
  struct Live {
    std::string generation;
    std::uint64_t bytes = 0;
  };
  // What is under catalog/<id>/.
  struct Generations {
    std::vector<Live> live;        // ascending: the first one stands for the tree
    std::vector<std::string> old;  // deleted a day ago
    Clock::time_point seen;        // the listing began after this
  };
  Result<Generations> GenerationsOf(const TreeId& id, const CancelToken& cancel);
  Result<TreeRecord> ReadLive(const TreeId& id, const Live& live, const CancelToken& cancel);
  Result<std::vector<ObjectInfo>> ListAll(std::string_view prefix, const CancelToken& cancel);
  Status PutFile(const std::string& key, const ReadableFile& file, std::span<std::byte> buffer,
                 PutMode mode, const CancelToken& cancel);
  Status PutParts(const std::string& key, const std::string& upload, const ReadableFile& file,
                  std::span<std::byte> buffer, PutMode mode, const CancelToken& cancel);
  Status RepairMesh(const TreeId& id, const std::string& generation, const ReadableFile& mesh,
                    std::span<std::byte> buffer, const CancelToken& cancel);
  void Clean(const TreeId& id, const std::string& generation, const CancelToken& cancel);
  void Forget(const TreeId& id, const Generations& generations, const CancelToken& cancel);

  ObjectStore* const store_;
};

}  // namespace kdray::core
