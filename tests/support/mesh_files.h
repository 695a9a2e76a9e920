// SPDX-License-Identifier: Apache-2.0
// The path of the collection of real and hostile meshes, and the bytes of its files.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

namespace kdray::test {

/// The collection's folder: the environment variable KDRAY_MESHES, else ../shared/meshes beside the
/// source folder. nullopt if it does not exist; tests are then skipped.
std::optional<std::filesystem::path> MeshFolder();

/// All bytes of a file; throws std::runtime_error if it cannot be read.
std::vector<std::byte> ReadFileBytes(const std::filesystem::path& path);

/// The bytes of a text, for files written inside a test.
std::vector<std::byte> Bytes(std::string_view text);

}  // namespace kdray::test

/// First line of a test that reads the collection.
#define KDRAY_NEED_MESHES()                                                                  \
  if (!::kdray::test::MeshFolder()) {                                                        \
    GTEST_SKIP() << "no mesh collection: set KDRAY_MESHES, or put it into ../shared/meshes " \
                    "beside the source folder";                                              \
  }                                                                                          \
  static_assert(true)
