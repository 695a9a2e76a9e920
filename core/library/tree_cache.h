// Meshes and trees in memory, least recently used ones let go first.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <variant>

#include "core/accel/build_kind.h"
#include "core/accel/tree.h"
#include "core/base/hash.h"
#include "core/catalog/parsed_mesh.h"
#include "core/library/memory_budget.h"

namespace kdray::core {

/// Each item carries the memory that it was charged; the charge is given back when the last user
/// lets go, so the budget is never wrong about a tree that was evicted or deleted while a query
/// ran on it. Bounded by whoever asks it for room (MemoryBudget::set_reclaim). A mesh counts
/// as used whenever one of its trees is, so a tree goes before the mesh it needs. Safe from many
/// threads at once; never waits for anything but its own short lock.
class TreeCache {
 public:
  using MeshPointer = std::shared_ptr<const PreparedMesh>;
  using TreePointer = std::shared_ptr<const Tree>;

  /// Null when it is not there. Counts as a use.
  MeshPointer FindMesh(const Sha256Digest& mesh);
  TreePointer FindTree(const Sha256Digest& mesh, BuildKind build);

  /// Replaces what had that key.
  MeshPointer InsertMesh(const Sha256Digest& mesh, PreparedMesh value, MemoryCharge charge);
  TreePointer InsertTree(const Sha256Digest& mesh, Tree value, MemoryCharge charge);

  void EraseTree(const Sha256Digest& mesh, BuildKind build);
  /// The mesh and its trees.
  void EraseMesh(const Sha256Digest& mesh);

  /// Lets go of items that nobody uses, least recently used first, until `bytes` are free or none
  /// is left; returns how many bytes were freed.
  std::uint64_t EvictIdle(std::uint64_t bytes);
  /// The same when that will free `bytes`; otherwise nothing goes.
  std::uint64_t EvictIdleIfEnough(std::uint64_t bytes);

  std::uint64_t evictions() const;
  std::size_t size() const;

 private:
  using Key = std::pair<Sha256Digest, std::optional<BuildKind>>;  // without a build: the mesh
  struct Item {
    Key key;
    std::variant<MeshPointer, TreePointer> value;
    std::uint64_t bytes;

    bool IsIdle() const {
      return std::visit([](const auto& pointer) { return pointer.use_count() == 1; }, value);
    }
  };
  using Items = std::list<Item>;

  template <class Pointer>
  Pointer Find(const Key& key);
  template <class T>
  std::shared_ptr<const T> Insert(const Key& key, T value, MemoryCharge charge);
  void MoveToFront(const Key& key);
  std::uint64_t EvictLocked(std::uint64_t bytes, Items* old);

  mutable std::mutex mutex_;
  Items items_;  // most recently used first
  std::map<Key, Items::iterator> index_;
  std::uint64_t evictions_ = 0;
};

}  // namespace kdray::core
