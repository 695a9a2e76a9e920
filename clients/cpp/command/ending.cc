// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/ending.h"

#include <algorithm>
#include <cctype>
#include <filesystem>

#include "kdray/error.h"

namespace kdray::client {

bool EndsIn(const std::string& path, const std::string& ending) {
  // The name has something before its ending: `.png` is a hidden file.
  if (path.size() < ending.size() + 2) return false;
  const std::size_t begin = path.size() - ending.size();
  if (path[begin - 1] != '.' || path[begin - 2] == '/') return false;
  return std::equal(
      ending.begin(), ending.end(), path.begin() + static_cast<std::ptrdiff_t>(begin),
      [](char a, char b) { return a == std::tolower(static_cast<unsigned char>(b)); });
}

std::string EndingsText(const std::vector<std::string>& endings) {
  std::string text;
  for (std::size_t i = 0; i < endings.size(); ++i) {
    if (i > 0) text += i + 1 == endings.size() ? " or " : ", ";
    text += "." + endings[i];
  }
  return text;
}

std::string TypeOfOutput(const std::string& path, const std::vector<std::string>& endings) {
  if (path == "-") return endings.front();
  for (const std::string& ending : endings) {
    if (EndsIn(path, ending)) return ending;
  }
  std::error_code ignored;
  const auto status = std::filesystem::status(path, ignored);
  if (std::filesystem::exists(status) && std::filesystem::is_other(status)) return endings.front();
  throw UsageError("'" + path + "' must end in " + EndingsText(endings) +
                   ", which decides what is written");
}

}  // namespace kdray::client
