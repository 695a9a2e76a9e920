// SPDX-License-Identifier: Apache-2.0
#include "core/catalog/tree_id.h"

namespace kdray::core {
namespace {

constexpr std::string_view kAuto = "auto";
constexpr std::size_t kHexDigits = 64;

}  // namespace

std::string TreeId::ToString() const {
  std::string text = mesh.ToHex();
  text += '-';
  text += build ? Name(*build) : kAuto;
  return text;
}

std::optional<TreeId> ParseTreeId(std::string_view text) {
  TreeId id;
  if (text.size() <= kHexDigits || text[kHexDigits] != '-' ||
      !ParseSha256Hex(text.substr(0, kHexDigits), &id.mesh)) {
    return std::nullopt;
  }
  const std::string_view build = text.substr(kHexDigits + 1);
  if (build != kAuto) {
    id.build = ParseBuildKind(build);
    if (!id.build) return std::nullopt;
  }
  return id;
}

}  // namespace kdray::core
