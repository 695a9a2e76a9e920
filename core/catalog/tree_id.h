// SPDX-License-Identifier: Apache-2.0
// The id of a tree: the hash of the mesh bytes and the requested build.
#pragma once

#include <compare>
#include <optional>
#include <string>
#include <string_view>

#include "core/accel/build_kind.h"
#include "core/base/hash.h"

namespace kdray::core {

/// Written as 64 lower-case hexadecimal digits, "-", and "auto" or Name(build).
struct TreeId {
  Sha256Digest mesh;               ///< of the mesh file's bytes
  std::optional<BuildKind> build;  ///< nullopt: `auto` (accel/auto_choice.h)

  std::string ToString() const;
  friend bool operator==(const TreeId&, const TreeId&) = default;
  friend auto operator<=>(const TreeId&, const TreeId&) = default;
};

/// nullopt unless `text` is exactly a result of ToString.
std::optional<TreeId> ParseTreeId(std::string_view text);

}  // namespace kdray::core
