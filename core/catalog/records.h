// SPDX-License-Identifier: Apache-2.0
// The records of trees and measured meshes, as values.
#pragma once

#include <cstdint>
#include <optional>

#include "core/accel/auto_choice.h"
#include "core/catalog/facts.h"
#include "core/catalog/tree_id.h"
#include "core/tradeoff/tradeoff.h"

namespace kdray::core {

/// The facts about a tree that describe it without its mesh and structure in memory.
struct TreeRecord {
  TreeId id;
  std::int64_t created_ms = 0;    ///< since 1970, UTC
  std::uint64_t mesh_bytes = 0;   ///< size of the mesh file
  std::uint32_t resumed = 0;      ///< starts that resumed its build and did not end it
  std::optional<MeshFacts> mesh;  ///< nullopt before it was parsed
  std::optional<TreeFacts> tree;  ///< nullopt: a build is due
  /// Why `auto` chose tree->build. Nullopt for other ids, for a mesh that needs no tree, and in
  /// records of older versions, which chose kd-sah for every other mesh.
  std::optional<AutoChoice> choice;
  friend bool operator==(const TreeRecord&, const TreeRecord&) = default;
};

struct MeasuredTradeoff {
  std::int64_t measured_ms = 0;  ///< when it ended; since 1970, UTC
  Tradeoff tradeoff;
  friend bool operator==(const MeasuredTradeoff&, const MeasuredTradeoff&) = default;
};

}  // namespace kdray::core
