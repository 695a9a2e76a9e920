// The load or build of one tree, shared by all who wait for it.
#pragma once

#include <condition_variable>
#include <optional>

#include "core/base/result.h"
#include "core/catalog/tree_id.h"
#include "core/library/memory_budget.h"
#include "core/library/scene_source.h"
#include "core/library/tree_library.h"

namespace kdray::core {

/// One flight loads or builds a tree for all requests that wait for it. A request that leaves does
/// not stop it. If it fails or its tree is deleted, all waiting requests get the error. Guarded by
/// the library's mutex, except `watch`.
struct TreeLibrary::Flight {
  Flight(const TreeId& tree_id, MemoryCharge charge) : id(tree_id), pledge(std::move(charge)) {}

  const TreeId id;
  SceneSource::Watch watch;
  bool is_resumed = false;    // begun by a start, not by a request
  bool is_asked_for = false;  // somebody has asked for its tree
  bool is_counted = false;    // in TreeRecord::resumed; the worker's
  MemoryCharge pledge;        // returned when it lands
  bool done = false;
  std::optional<Error> error;  // set at the end if there is no tree
  std::optional<Scene> scene;  // set at the end without an error
  std::condition_variable landed;
};

}  // namespace kdray::core
