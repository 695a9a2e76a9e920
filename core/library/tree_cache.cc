// SPDX-License-Identifier: Apache-2.0
#include "core/library/tree_cache.h"

namespace kdray::core {
namespace {

// The value of an item and its memory charge, which the item's pointer keeps alive.
template <class T>
struct Charged {
  T value;
  MemoryCharge charge;
};

}  // namespace

void TreeCache::MoveToFront(const Key& key) {
  if (const auto found = index_.find(key); found != index_.end()) {
    items_.splice(items_.begin(), items_, found->second);
  }
}

template <class Pointer>
Pointer TreeCache::Find(const Key& key) {
  const std::lock_guard lock(mutex_);
  const auto found = index_.find(key);
  if (found == index_.end()) return nullptr;
  MoveToFront(key);
  MoveToFront({key.first, kMesh});
  return std::get<Pointer>(found->second->value);
}

template <class T>
std::shared_ptr<const T> TreeCache::Insert(const Key& key, T value, MemoryCharge charge) {
  const std::uint64_t bytes = charge.bytes();
  const auto owner = std::make_shared<Charged<T>>(Charged<T>{std::move(value), std::move(charge)});
  const std::shared_ptr<const T> pointer(owner, &owner->value);
  Items old;  // destroyed after the lock: returning a charge wakes others
  Items fresh;
  fresh.push_front(Item{key, pointer, bytes});
  const std::lock_guard lock(mutex_);
  const auto [place, is_new] = index_.try_emplace(key);
  // Nothing is allocated from here on.
  if (!is_new) old.splice(old.begin(), items_, place->second);
  items_.splice(items_.begin(), fresh);
  place->second = items_.begin();
  MoveToFront({key.first, kMesh});
  return pointer;
}

TreeCache::MeshPointer TreeCache::FindMesh(const Sha256Digest& mesh) {
  return Find<MeshPointer>({mesh, kMesh});
}

TreeCache::TreePointer TreeCache::FindTree(const Sha256Digest& mesh, BuildKind build) {
  return Find<TreePointer>(TreeKey(mesh, build));
}

TreeCache::MeshPointer TreeCache::InsertMesh(const Sha256Digest& mesh, ParsedMesh value,
                                             MemoryCharge charge) {
  return Insert<ParsedMesh>({mesh, kMesh}, std::move(value), std::move(charge));
}

TreeCache::TreePointer TreeCache::InsertTree(const Sha256Digest& mesh, Tree value,
                                             MemoryCharge charge) {
  const BuildKind build = value.build;
  return Insert<Tree>(TreeKey(mesh, build), std::move(value), std::move(charge));
}

TreeCache::AttributesPointer TreeCache::FindAttributes(const Sha256Digest& mesh) {
  return Find<AttributesPointer>({mesh, kAttributes});
}

TreeCache::AttributesPointer TreeCache::InsertAttributes(const Sha256Digest& mesh,
                                                         MeshAttributes value,
                                                         MemoryCharge charge) {
  return Insert<MeshAttributes>({mesh, kAttributes}, std::move(value), std::move(charge));
}

void TreeCache::EraseTree(const Sha256Digest& mesh, BuildKind build) {
  Items old;
  const std::lock_guard lock(mutex_);
  if (const auto found = index_.find(TreeKey(mesh, build)); found != index_.end()) {
    old.splice(old.begin(), items_, found->second);
    index_.erase(found);
  }
}

void TreeCache::EraseMesh(const Sha256Digest& mesh) {
  Items old;
  const std::lock_guard lock(mutex_);
  // The mesh has the first key with this hash.
  auto next = index_.lower_bound({mesh, kMesh});
  while (next != index_.end() && next->first.first == mesh) {
    old.splice(old.begin(), items_, next->second);
    next = index_.erase(next);
  }
}

std::uint64_t TreeCache::EvictIdle(std::uint64_t bytes) {
  Items old;  // destroyed after the lock
  const std::lock_guard lock(mutex_);
  return EvictLocked(bytes, &old);
}

std::uint64_t TreeCache::EvictIdleIfEnough(std::uint64_t bytes) {
  Items old;
  const std::lock_guard lock(mutex_);
  std::uint64_t idle = 0;
  for (const Item& item : items_) idle += item.IsIdle() ? item.bytes : 0;
  return idle < bytes ? 0 : EvictLocked(bytes, &old);
}

std::uint64_t TreeCache::EvictLocked(std::uint64_t bytes, Items* old) {
  std::uint64_t freed = 0;
  for (auto next = items_.end(); next != items_.begin() && freed < bytes;) {
    --next;
    // Only this cache returns copies, under this lock, so an idle item stays idle until it is
    // erased.
    if (!next->IsIdle()) continue;
    const auto victim = next++;
    freed += victim->bytes;
    ++evictions_;
    index_.erase(victim->key);
    old->splice(old->begin(), items_, victim);
  }
  return freed;
}

std::uint64_t TreeCache::evictions() const {
  const std::lock_guard lock(mutex_);
  return evictions_;
}

std::size_t TreeCache::size() const {
  const std::lock_guard lock(mutex_);
  return items_.size();
}

}  // namespace kdray::core
