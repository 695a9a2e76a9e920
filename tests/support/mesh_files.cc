// SPDX-License-Identifier: Apache-2.0
#include "tests/support/mesh_files.h"

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <stdexcept>

namespace kdray::test {

std::optional<std::filesystem::path> MeshFolder() {
  const char* named = std::getenv("KDRAY_MESHES");
  const std::filesystem::path folder =
      named != nullptr && *named != '\0'
          ? std::filesystem::path(named)
          : std::filesystem::path(KDRAY_SOURCE_DIR).parent_path() / "shared" / "meshes";
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error)) return std::nullopt;
  return folder;
}

std::vector<std::byte> ReadFileBytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::vector<std::byte> bytes(file ? std::filesystem::file_size(path) : 0);
  if (!file || !file.read(reinterpret_cast<char*>(bytes.data()),
                          static_cast<std::streamsize>(bytes.size()))) {
    throw std::runtime_error("cannot read " + path.string());
  }
  return bytes;
}

std::vector<std::byte> Bytes(std::string_view text) {
  std::vector<std::byte> bytes(text.size());
  if (!text.empty()) std::memcpy(bytes.data(), text.data(), text.size());
  return bytes;
}

}  // namespace kdray::test
