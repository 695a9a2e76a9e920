#include "api/names.h"

namespace kdray::api {

std::optional<Build> ParseBuild(std::string_view name) {
  for (std::size_t i = 0; i < kBuildNames.size(); ++i) {
    if (kBuildNames[i] == name) return static_cast<Build>(i);
  }
  return std::nullopt;
}

}  // namespace kdray::api
