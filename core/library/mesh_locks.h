// SPDX-License-Identifier: Apache-2.0
// The library's locks and the order in which they are taken.
//
//   1. MeshLocks        held to write or remove a mesh's files or records, also during disk work
//   2. TreeRegistry     the state of all trees; never held during disk work
//      BinaryRebuilder  the running rebuilds; never held during work
//   3. TreeTask, WorkQueue, TreeCache, MemoryBudget, Measurements, SceneStore, Tree
//                       short locks inside these classes, held for no call to another class
//
// A thread that holds a lock takes only locks of later levels, so no two locks of one level. No
// thread waits for a task, for memory or for a job while it holds a lock.
#pragma once

#include <array>
#include <cstddef>
#include <mutex>

#include "core/base/hash.h"

namespace kdray::core {

/// A lock for each mesh; some meshes share one.
class MeshLocks {
 public:
  std::mutex& Of(const Sha256Digest& mesh) { return mutexes_[mesh.bytes[0] % mutexes_.size()]; }

 private:
  std::array<std::mutex, 64> mutexes_;
};

}  // namespace kdray::core
