// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/mesh_files.h"

#include <glob.h>

#include <algorithm>
#include <filesystem>

#include "clients/cpp/command/ending.h"
#include "kdray/error.h"

namespace kdray::client {

const std::vector<std::string> kMeshEndings = {"obj", "ply", "stl", "off", "glb", "gltf"};

namespace {

namespace fs = std::filesystem;

bool IsMeshFile(const std::string& path) {
  return std::any_of(kMeshEndings.begin(), kMeshEndings.end(),
                     [&](const std::string& ending) { return EndsIn(path, ending); });
}

std::vector<std::string> FilesBelow(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;
  fs::recursive_directory_iterator entry(folder, error);
  for (; !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
    std::error_code ignored;
    if (entry->is_regular_file(ignored) && IsMeshFile(entry->path())) {
      files.push_back(entry->path());
    }
  }
  if (error) throw LocalFileError(folder + ": " + error.message());
  if (files.empty()) {
    throw LocalFileError(folder + ": no mesh file in this directory; they end in " +
                         EndingsText(kMeshEndings));
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<std::string> FilesLike(const std::string& pattern) {
  glob_t found{};
  const int failed = glob(pattern.c_str(), GLOB_ERR, nullptr, &found);
  std::vector<std::string> files(found.gl_pathv,
                                 found.gl_pathv + (failed == 0 ? found.gl_pathc : 0));
  globfree(&found);
  std::erase_if(files, [](const std::string& path) {
    std::error_code ignored;
    return fs::is_directory(path, ignored);
  });
  if (files.empty()) throw LocalFileError(pattern + ": no file matches this pattern");
  return files;
}

}  // namespace

std::vector<std::string> ExpandMeshFiles(const std::vector<std::string>& arguments) {
  std::vector<std::string> files;
  for (const std::string& argument : arguments) {
    std::error_code ignored;
    const bool exists = fs::exists(argument, ignored);
    std::vector<std::string> found = {argument};
    if (fs::is_directory(argument, ignored)) {
      found = FilesBelow(argument);
    } else if (!exists && argument.find_first_of("*?[") != std::string::npos) {
      found = FilesLike(argument);
    }
    files.insert(files.end(), found.begin(), found.end());
  }
  return files;
}

}  // namespace kdray::client
