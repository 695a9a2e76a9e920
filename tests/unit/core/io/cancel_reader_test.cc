// SPDX-License-Identifier: Apache-2.0
// Reading a mesh file ends soon after its cancellation, however long its longest row, blank or
// number is.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/mesh_reader.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/mesh_files.h"
#include "tests/unit/core/io/mesh_texts.h"

namespace kdray::core {
namespace {

using std::chrono::milliseconds;

std::string Repeat(std::string_view piece, std::size_t bytes) {
  if (piece.size() == 1) return std::string(bytes, piece[0]);
  std::string text(piece);
  while (text.size() < bytes) text += text;
  return text.substr(0, bytes / piece.size() * piece.size());
}

struct LongFile {
  std::string name;
  std::string before;  ///< the file is this,
  std::string piece;   ///< this over and over,
  std::string after;   ///< and this
  /// Fraction of the requested bytes: text that is much slower than blanks is shorter.
  std::size_t part = 1;

  std::string Make(std::size_t bytes) const { return before + Repeat(piece, bytes / part) + after; }
};

std::vector<LongFile> LongFiles(std::size_t bytes) {
  const std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const std::string off = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n";
  const std::string ply =
      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uint uchar vertex_indices\nend_header\n";
  const std::string ascii = "ply\nformat ascii 1.0\n" + ply + "0 0 0\n1 0 0\n0 1 0\n";
  const std::string facet =
      "facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
      "endfacet\n";
  // A list as long as its bytes, whose last entry is not a vertex.
  const auto items = static_cast<std::uint32_t>(bytes / 8 + 1);
  const std::string binary = "ply\nformat binary_little_endian 1.0\n" + ply +
                             std::string(36, '\0') + Raw<std::uint32_t>(items);
  return {
      {"blank lines", "", "\n", ""},
      {"blanks", "", " ", ""},
      {"one word of no format", "", "x", ""},
      {"words of no format", "", "x ", ""},
      {"OBJ, blank lines", obj, "\n", "f 1 2 3\n"},
      {"OBJ, blanks in a line", obj + "f 1 2", " ", "3\n"},
      {"OBJ, a long remark", obj + "#", "x", "\nf 1 2 3\n"},
      {"OBJ, a long name", obj + "o", " ", "x\nf 1 2 3\n"},
      {"OBJ, a face", obj + "f", " 1", " x\n", 2},
      {"OBJ, a number", obj + "v 0 0 ", "1", "\n"},
      {"OBJ, joined lines", obj + "f 1 2", "\\\n", "3\n"},
      {"OBJ, padding", obj + "f 1 2 3\n", std::string(1, '\0'), ""},
      {"OFF, blank lines", off, "\n", "3 0 1 2\n"},
      {"OFF, blanks in a line", off + "3 0 1", " ", "2\n"},
      {"OFF, a face", off + std::to_string(bytes / 4), " 0", " x\n", 2},
      {"OFF, a number", "OFF\n3 1 0\n0 0 ", "1", "\n0 0 0\n1 0 0\n3 0 1 2\n"},
      {"OFF, a keyword", "", "C", "OFF\n3 1 0\n"},
      {"PLY, header lines", "ply\n", "comment\n", "format ascii 1.0\n" + ply},
      {"PLY, blanks in the header", "ply\n", " ", "format ascii 1.0\n" + ply},
      {"PLY, blank lines", ascii, "\n", "3 0 1 2\n"},
      {"PLY, a face", ascii + std::to_string(bytes / 4), " 0", " x\n", 2},
      {"PLY, a number", ascii + "3 0 1 ", "1", "\n"},
      {"binary PLY, a face", binary, std::string(1, '\0'), "\xff", 8},
      {"STL, blank lines", "solid a\n", "\n", facet},
      {"STL, a long name", "solid", " a", "\n" + facet},
      {"STL, words after a normal", "solid\nfacet normal", " 0", "\nouter loop\n"},
      {"binary STL, padding", std::string(80, 'x') + Raw<std::uint32_t>(1) + std::string(50, '\0'),
       std::string(1, '\0'), ""},
  };
}

TEST(CancelledRead, LooksAtItsTokenAllAlongALongRow) {
  constexpr std::size_t kBytes = std::size_t{4} << 20;
  for (const LongFile& file : LongFiles(kBytes)) {
    const std::string text = file.Make(kBytes);
    const auto looks = std::make_shared<std::atomic<std::uint64_t>>(0);
    const CancelToken token = CancelToken::When([looks] {
      ++*looks;
      return false;
    });
    // NOLINTNEXTLINE(bugprone-unused-return-value): some are meshes, some are not
    (void)ReadMesh(test::Bytes(text), {token});
    // A look at the beginning of each step is not enough; memchr passes some bytes in a unit.
    EXPECT_GE(*looks, 2 + text.size() / (std::size_t{1} << 20)) << file.name;
  }
}

TEST(CancelledRead, EndsWithinALongRow) {
  const std::size_t bytes = test::CancelScale() << 26;
  for (const LongFile& file : LongFiles(bytes)) {
    const std::string text = file.Make(bytes);
    for (const milliseconds after : {milliseconds(2), milliseconds(30)}) {
      test::ExpectPrompt(test::CancelDuring(after,
                                            [&](const CancelToken& token) -> Status {
                                              for (;;) {
                                                const auto mesh =
                                                    ReadMesh(test::Bytes(text), {token});
                                                if (token.ShouldStop()) return test::StatusOf(mesh);
                                              }
                                            }),
                         file.name + " after " + std::to_string(after.count()) + " ms");
    }
  }
}

// Many lines, words or remarks, each of which a reader may look beyond.
std::vector<LongFile> RepetitiveFiles() {
  const std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const std::string off = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n";
  const std::string ascii =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list uint uchar vertex_indices\nend_header\n"
      "0 0 0\n1 0 0\n0 1 0\n";
  const std::string facet =
      "facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
      "endfacet\n";
  return {
      {"OBJ, lines joined to a name", obj + "usemtl x\\\n", "\\\n", "3\nf 1 2 3\n"},
      {"OBJ, blanks joined to a name", obj + "usemtl x\\\n", " \\\n", "3\nf 1 2 3\n"},
      {"OBJ, names joined to a name", obj + "usemtl x\\\n", "y\\\n", "3\nf 1 2 3\n"},
      {"OBJ, lines joined after remarks", obj, "usemtl # x\\\n\\\n", "f 1 2 3\n"},
      {"OFF, remarks", off, "#\n", "3 0 1 2\n"},
      {"OFF, headers", "", "OFF\n", "3 1 0\n"},
      {"PLY, remarks among rows", ascii, "comment c\n", "3 0 1 2\n"},
      {"PLY, words that begin like remarks", ascii, "c\n", "3 0 1 2\n"},
      {"STL, solids", "", "solid\n", facet},
      {"STL, names that look like facets", "solid", " facet", "\n" + facet},
      {"STL, names with normals", "solid", " facet normal 0 0 0", "\n" + facet},
      {"STL, solids before blank lines", "", "solid facet\n\n", facet},
      {"STL, ends", "solid\n", "end ", "\n" + facet},
      {"STL, remarks", "solid\n", "#\n", facet},
  };
}

// Four times the bytes take some four times the time; sixteen times would be the square.
TEST(ReadMesh, TakesTimeInProportionToTheLengthOfARow) {
  const auto time_of = [](const LongFile& file, std::size_t bytes) {
    const std::vector<std::byte> text = test::Bytes(file.Make(bytes));
    auto least = std::chrono::nanoseconds::max();
    for (int i = 0; i < 3; ++i) {
      const auto begin = test::ThreadTime();
      // NOLINTNEXTLINE(bugprone-unused-return-value): some are meshes, some are not
      (void)ReadMesh(text);
      least = std::min(least, test::ThreadTime() - begin);
    }
    return least;
  };
#ifdef __SANITIZE_ADDRESS__
  constexpr milliseconds kSlack(100);  // fresh memory costs more than the reading
#else
  constexpr milliseconds kSlack(10);
#endif
  constexpr std::size_t kBytes = std::size_t{1} << 16;
  std::vector<LongFile> files = LongFiles(4 * kBytes);
  for (const LongFile& file : RepetitiveFiles()) files.push_back(file);
  for (const LongFile& file : files) {
    EXPECT_LT(time_of(file, 4 * kBytes), 10 * time_of(file, kBytes) + kSlack) << file.name;
  }
}

TEST(CancelledRead, NeverAnswersAPartOfTheMesh) {
  std::string text;
  for (int i = 0; i < 3'000; ++i) text += "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n\n\n";
  for (std::uint64_t look = 1; look < 200; ++look) {
    const Result<MeshData> mesh = ReadMesh(test::Bytes(text), {test::CancelledAtLook(look)});
    if (mesh.ok()) {
      EXPECT_EQ(mesh->triangles.size(), 3'000U);
      EXPECT_GT(look, 5U) << "it is looked at now and then";
      return;
    }
    ASSERT_EQ(mesh.error().code, ErrorCode::kCancelled) << look;
  }
  FAIL() << "the text is too long for this test";
}

}  // namespace
}  // namespace kdray::core
