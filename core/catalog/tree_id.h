// The name of a tree: which mesh bytes, and which structure over them was asked for.
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
  std::optional<BuildKind> build;  ///< none: `auto`, what AutoBuildKind picks for the mesh

  std::string ToString() const;
  friend bool operator==(const TreeId&, const TreeId&) = default;
  friend auto operator<=>(const TreeId&, const TreeId&) = default;
};

/// Nothing unless `text` is exactly what ToString writes.
std::optional<TreeId> ParseTreeId(std::string_view text);

}  // namespace kdray::core
