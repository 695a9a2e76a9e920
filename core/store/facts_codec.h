// SPDX-License-Identifier: Apache-2.0
// The encoding of facts about meshes and trees in stored files.
#pragma once

#include <cstdint>
#include <optional>

#include "core/base/enumerators.h"
#include "core/catalog/facts.h"
#include "core/store/checked_file.h"

namespace kdray::core {

template <>
inline constexpr bool kStorable<Vec3f> = true;
template <>
inline constexpr bool kStorable<Vec3d> = true;
template <>
inline constexpr bool kStorable<Bounds3f> = true;
template <>
inline constexpr bool kStorable<Bounds3d> = true;
template <>
inline constexpr bool kStorable<Sha256Digest> = true;

/// An enumerator as a number; reading fails for a number that no enumerator has.
template <class Enum>
void PutEnum(Enum value, CheckedWriter* writer) {
  writer->Put(static_cast<std::uint8_t>(value));
}
template <class Enum>
Enum GetEnum(CheckedReader* reader) {
  return static_cast<Enum>(reader->GetBelow(static_cast<std::uint8_t>(kAll<Enum>.size())));
}
void PutBool(bool value, CheckedWriter* writer);
bool GetBool(CheckedReader* reader);

/// Without the facts of PutSurfaceFacts, which older files do not have.
void PutMeshFacts(const MeshFacts& facts, CheckedWriter* writer);
MeshFacts GetMeshFacts(CheckedReader* reader);
/// Area, volume and number of groups.
void PutSurfaceFacts(const MeshFacts& facts, CheckedWriter* writer);
void GetSurfaceFacts(CheckedReader* reader, MeshFacts* facts);

/// How TreeStats stand in a file: older files do not tell max_leaf.
enum class TreeStatsLayout : std::uint8_t { kWithoutMaxLeaf, kWithMaxLeaf };

/// Writes kWithMaxLeaf.
void PutTreeStats(const TreeStats& stats, CheckedWriter* writer);
/// nullopt when a file without max_leaf does not let it be derived: its histogram counts the leaves
/// beyond TreeStats::kHistogramLeaf together. Then the tree has to be made again.
std::optional<TreeStats> GetTreeStats(TreeStatsLayout layout, CheckedReader* reader);

}  // namespace kdray::core
