// SPDX-License-Identifier: Apache-2.0
// What passes between a worker that brings a tree into memory and those who wait for it.
#pragma once

#include <atomic>
#include <memory>
#include <optional>

#include "core/accel/auto_choice.h"
#include "core/base/cancel.h"
#include "core/base/progress.h"
#include "core/catalog/parsed_mesh.h"
#include "core/scene/scene.h"

namespace kdray::core {

/// What others see of the work, and how they stop it. Written by the worker, read by anyone.
struct LoadWatch {
  CancelToken cancel = CancelToken::Cancellable();
  Progress build_progress;
  std::atomic<bool> parsed{false};
  std::atomic<bool> waits_for_memory{false};

  /// 0..1; parsing counts a tenth.
  double fraction() const { return parsed ? 0.1 + 0.9 * build_progress.fraction() : 0.0; }
};

/// A scene in memory, and how it came there.
struct LoadedScene {
  Scene scene;
  std::shared_ptr<const ParsedMesh> parsed;
  TreeFacts tree;
  std::optional<AutoChoice> choice;  ///< as TreeRecord::choice
  bool was_parsed = false;           ///< not read from a stored file, so worth storing
  bool was_built = false;
};

}  // namespace kdray::core
