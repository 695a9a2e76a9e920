// SPDX-License-Identifier: Apache-2.0
// Meshes, their attributes and trees in memory; the least recently used are evicted first.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <utility>
#include <variant>

#include "core/accel/build_kind.h"
#include "core/accel/tree.h"
#include "core/base/hash.h"
#include "core/catalog/parsed_mesh.h"
#include "core/io/mesh_attributes.h"
#include "core/library/memory_budget.h"

namespace kdray::core {

/// Each item has its memory charge, which is returned when its last user releases it. So the budget
/// is right about a tree that was evicted or deleted during a query. MemoryBudget calls it for
/// eviction (set_reclaim). Using a tree or attributes also uses their mesh, so they are evicted
/// before it.
/// Safe from many threads at once; waits only for its own short lock.
class TreeCache {
 public:
  using MeshPointer = std::shared_ptr<const ParsedMesh>;
  using TreePointer = std::shared_ptr<const Tree>;
  using AttributesPointer = std::shared_ptr<const MeshAttributes>;

  /// Null if it is not cached. Counts as a use.
  MeshPointer FindMesh(const Sha256Digest& mesh);
  TreePointer FindTree(const Sha256Digest& mesh, BuildKind build);
  AttributesPointer FindAttributes(const Sha256Digest& mesh);

  /// Replaces the item with that key.
  MeshPointer InsertMesh(const Sha256Digest& mesh, ParsedMesh value, MemoryCharge charge);
  TreePointer InsertTree(const Sha256Digest& mesh, Tree value, MemoryCharge charge);
  AttributesPointer InsertAttributes(const Sha256Digest& mesh, MeshAttributes value,
                                     MemoryCharge charge);

  void EraseTree(const Sha256Digest& mesh, BuildKind build);
  /// Erases the mesh, its attributes and its trees.
  void EraseMesh(const Sha256Digest& mesh);

  /// Evicts unused items, least recently used first, until `bytes` are free or no unused item is
  /// left; returns the number of freed bytes.
  std::uint64_t EvictIdle(std::uint64_t bytes);
  /// The same if that frees `bytes`; otherwise evicts nothing.
  std::uint64_t EvictIdleIfEnough(std::uint64_t bytes);

  std::uint64_t evictions() const;
  std::size_t size() const;

 private:
  // What of a mesh an item is: the mesh itself sorts first, a tree is kFirstTree + its build.
  enum Slot : int { kMesh, kAttributes, kFirstTree };
  using Key = std::pair<Sha256Digest, int>;
  static Key TreeKey(const Sha256Digest& mesh, BuildKind build) {
    return {mesh, kFirstTree + static_cast<int>(build)};
  }
  struct Item {
    Key key;
    std::variant<MeshPointer, TreePointer, AttributesPointer> value;
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
