// SPDX-License-Identifier: Apache-2.0
#include "core/accel/build_kind.h"

namespace kdray::core {

std::optional<BuildKind> ParseBuildKind(std::string_view name) {
  for (const BuildKind kind : kAllBuildKinds) {
    if (Name(kind) == name) return kind;
  }
  return std::nullopt;
}

}  // namespace kdray::core
