// SPDX-License-Identifier: Apache-2.0
#include "api/tree_id.h"

#include <algorithm>

#include "api/names.h"

namespace kdray::api {

bool IsSha256(std::string_view text) {
  return text.size() == 64 && std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

std::string FormatTreeId(std::string_view sha256, Build build) {
  return std::string(sha256) + '-' + std::string(Name(build));
}

namespace {

std::optional<Build> ParseBuild(std::string_view name) {
  const auto found = std::find(kBuildNames.begin(), kBuildNames.end(), name);
  if (found == kBuildNames.end()) return std::nullopt;
  return static_cast<Build>(found - kBuildNames.begin());
}

}  // namespace

std::optional<TreeId> ParseTreeId(std::string_view text) {
  const std::string_view sha256 = text.substr(0, 64);
  if (!IsSha256(sha256) || text.size() < 65 || text[64] != '-') return std::nullopt;
  const std::optional<Build> build = ParseBuild(text.substr(65));
  if (!build) return std::nullopt;
  return TreeId{std::string(sha256), *build};
}

}  // namespace kdray::api
