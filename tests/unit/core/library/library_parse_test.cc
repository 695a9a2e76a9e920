// SPDX-License-Identifier: Apache-2.0
// What a mesh takes in memory is reserved from its counts before it is parsed.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/unit/core/library/library_fixture.h"

namespace kdray::test {
namespace {

using core::ErrorCode;

// Two bytes for each triangle.
std::vector<std::byte> OneLargeFace(std::size_t corners) {
  std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf";
  for (std::size_t i = 0; i < corners; ++i) obj += " 1";
  return Bytes(obj + "\nf 1 2 3\n");
}

class LibraryParseTest : public LibraryTest {};

TEST_F(LibraryParseTest, AMeshOfTooManyTrianglesForTheMemoryIsRefusedAndDroppedWhole) {
  const auto bytes = OneLargeFace(200'000);
  options_.memory_limit_bytes = 6 * bytes.size();  // 5 times are enough for usual files
  Open();
  const auto added = Upload(library_.get(), bytes);
  ASSERT_TRUE(added.ok()) << added.error().message;
  EXPECT_EQ(library_->Load(added->id, Soon()).error().code, ErrorCode::kMeshTooLarge);
  EXPECT_EQ(CodeOfFind(added->id), ErrorCode::kMeshTooLarge);
  library_->Shutdown();  // who waits is answered before the files go
  EXPECT_EQ(FilesIn("catalog"), 0u);
  EXPECT_EQ(FilesIn("meshes"), 0u);
  EXPECT_EQ(library_->counters().memory_bytes, 0u);
  Open();
  EXPECT_EQ(CodeOfFind(added->id), ErrorCode::kNotFound);
  EXPECT_EQ(library_->counters().parses, 0u) << "no start parses it again";
}

}  // namespace
}  // namespace kdray::test
