// SPDX-License-Identifier: Apache-2.0
// Tree ids: `<sha256 of the mesh bytes, 64 lower-case hexadecimal digits>-<build>`.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "api/types.h"

namespace kdray::api {

struct TreeId {
  std::string sha256;  ///< 64 lower-case hexadecimal digits
  Build build = Build::kAuto;
  friend bool operator==(const TreeId&, const TreeId&) = default;
};

bool IsSha256(std::string_view text);
std::string FormatTreeId(std::string_view sha256, Build build);
/// nullopt for an invalid id, and for a build that this version does not have: no such tree can
/// exist (tree_not_found).
std::optional<TreeId> ParseTreeId(std::string_view text);

}  // namespace kdray::api
