// Work under way for one tree, shared by all who wait for it.
#pragma once

#include <condition_variable>
#include <optional>

#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/library/memory_budget.h"
#include "core/library/scene_source.h"
#include "core/library/tree_library.h"

namespace kdray::core {

/// However many ask for a tree that is not in memory, one flight brings it. It belongs to none of
/// them: who leaves leaves the others waiting, and when it fails or its tree is deleted, all of
/// them are told. Guarded by the library's mutex, but for `watch`.
struct TreeLibrary::Flight {
  Flight(const TreeId& tree_id, MemoryCharge charge) : id(tree_id), pledge(std::move(charge)) {}

  const TreeId id;
  SceneSource::Watch watch;
  MemoryCharge pledge;  // given back when it lands
  bool done = false;
  std::optional<Error> error;  // once done: why there is no tree
  std::optional<Scene> scene;  // once done without an error
  std::condition_variable landed;
};

}  // namespace kdray::core
