// SPDX-License-Identifier: Apache-2.0
#include "core/io/mesh_reader.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "tests/support/allocation_count.h"
#include "tests/support/csv.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"
#include "tests/unit/core/io/gltf_texts.h"
#include "tests/unit/core/io/mesh_texts.h"

namespace kdray::core {
namespace {

// What the daemon does with an upload: parse, then check as a mesh.
Result<TriangleMesh> ReadAndCheck(std::span<const std::byte> bytes) {
  Result<MeshData> data = ReadMesh(bytes);
  if (!data.ok()) return std::move(data).error();
  return TriangleMesh::Create(*data);
}

TEST(MeshReader, FindsTheFormatFromTheBytesAlone) {
  const std::string facet =
      "facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet\n";
  for (const auto& [text, format] : std::map<std::string, MeshFormat>{
           {"# Blender\nmtllib x\nv 0 0 0\nf 1 1 1\n", MeshFormat::kObj},
           {"f 1 1 1\nv 0 0 0\n", MeshFormat::kObj},
           {"\xef\xbb\xbfo name\nv 0 0 0\nf 1 1 1\n", MeshFormat::kObj},
           {"\n\n  v 0 0 0\nf 1 1 1\n", MeshFormat::kObj},
           {"ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nproperty int y\nproperty int "
            "z\nelement face 1\nproperty list int int vertex_index\nend_header\n0 0 0\n3 0 0 0\n",
            MeshFormat::kPly},
           {"solid\n" + facet, MeshFormat::kStl},
           {"  Solid x\n" + facet, MeshFormat::kStl},
           {"OFF\n1 1 0\n0 0 0\n3 0 0 0\n", MeshFormat::kOff},
           {"# no keyword\n1 1 0\n0 0 0\n3 0 0 0\n", MeshFormat::kOff},
           {GltfText(), MeshFormat::kGltf},
           {"\xef\xbb\xbf \n" + GltfText(), MeshFormat::kGltf},
           {GlbOf(GltfText()), MeshFormat::kGlb},
       }) {
    EXPECT_EQ(MustRead(text).format, format) << text;
  }
}

TEST(MeshReader, NamesWhatItDoesNotReadAndWhatToSendInstead) {
  struct Case {
    std::string bytes;
    std::string what;
    std::string advice;
  };
  std::string tar(300, '\0');
  tar.replace(257, 5, "ustar");
  const std::string unpack = "unpack it";
  const std::string convert = "export the mesh as GLB, OBJ, PLY, STL or OFF";
  const std::string points = "points have no surface";
  const std::string form = "send the file itself (curl --data-binary @FILE)";
  const std::string unknown = "in no known format (they begin with ";
  for (const Case& c : {
           Case{" {}", "JSON without 'asset', so they are not glTF", ""},
           Case{"[1, 2]", "JSON", ""},
           Case{"\x1f\x8b\x08", "gzip data", unpack},
           Case{"BZh91AY", "bzip2 data", unpack},
           Case{"\xfd"
                "7zXZ",
                "xz data", unpack},
           Case{"\x28\xb5\x2f\xfd", "Zstandard data", unpack},
           Case{tar, "a tar archive", unpack},
           Case{"PK\x03\x04", "a ZIP archive", unpack},
           Case{std::string("PK\x03\x04\0\0arr_0.npy", 15), "a ZIP archive of arrays (npz)", ""},
           Case{std::string("PK\x03\x04\0\0[Content_Types].xml", 25),
                "a ZIP archive, perhaps a 3MF file", convert},
           Case{"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 284\n",
                "a Git LFS pointer", "git lfs pull"},
           Case{"--XX\r\nContent-Disposition: form-data; name=\"f\"; filename=\"a.obj\"\r\n\r\n"
                "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n\r\n--XX--\r\n",
                "a multipart form (curl -F", form},
           Case{"v%200%200%200%0Av%201%200%200%0Af%201%201%202", "text as a form encodes it", form},
           Case{std::string("MM\x1a\0\0\0\x02\0\x0a\0\0\0\3\0\0\0==", 18) + std::string(8, '\0'),
                "a 3DS file", convert},
           Case{"<?xml version=\"1.0\"?>\n<!-- a -->\n<COLLADA xmlns=\"x\">", "a COLLADA file",
                convert},
           Case{"\xef\xbb\xbf<?xml version=\"1.0\"?><!DOCTYPE X3D PUBLIC \"a\"><X3D>",
                "an X3D file", convert},
           Case{"<model unit=\"millimeter\">", "the model of a 3MF file", convert},
           Case{"<amf>", "an AMF file", convert},
           Case{"<VTKFile type=\"PolyData\">", "a VTK file", convert},
           Case{"<Error><Code>NoSuchKey</Code></Error>", "an XML file", convert},
           Case{"<!DOCTYPE html><html></html>", "an HTML page", "download the mesh"},
           Case{"\n  <html lang=en>", "an HTML page", "download the mesh"},
           Case{"# vtk DataFile Version 3.0\n", "a VTK file", convert},
           Case{"#VRML V2.0 utf8\n", "a VRML file", convert},
           Case{"ISO-10303-21;\n", "a STEP file", convert},
           Case{std::string(72, ' ') + "S      1\n", "an IGES file", convert},
           Case{"  0\nSECTION\n  2\nHEADER\n", "a DXF file", convert},
           Case{"Kaydara FBX Binary  ", "an FBX file", convert},
           Case{"; FBX 6.1.0 project file\n", "an FBX file", convert},
           Case{"BLENDER-v300", "a Blender file", convert},
           Case{"#usda 1.0\n", "a USD file", convert},
           Case{"# .PCD v0.7\nVERSION 0.7\n", "a PCD file, a list of points", points},
           Case{"LASF", "a LAS file, a list of points", points},
           Case{"0.5 0 0\n1 0 0.25\n", "a list of points", points},
           Case{"2\n0.5 0 0 255 0 0\n1 0 0.25 255 0 0\n", "a list of points", points},
           Case{"x,y,z\n0.5,0,0\n1,0,0.25\n", "a list of points", points},
           Case{"\x89PNG\r\n", "a PNG picture", "send the mesh"},
           Case{"\xff\xd8\xff\xe0", "a JPEG picture", "send the mesh"},
           Case{"%PDF-1.4\n", "a PDF document", "send the mesh"},
           Case{"\xfe\xff", "text in UTF-16, not UTF-8", "save it as UTF-8"},
           Case{"plywood", unknown + "'plywood')", ""},
           Case{"hello world\nagain", unknown + "'hello world')", ""},
           Case{"1 2\n3 4\n", unknown + "'1 2')", ""},
           Case{"newmtl a\nKd 1 1 1\n", "the materials of an OBJ file (MTL)", "the .obj file"},
           Case{std::string("\1\0\2", 3), unknown + "'\\x01\\x00\\x02')", ""},
           Case{std::string(83, '\1'), unknown, ""},
           Case{"@cube.obj", "the name of a file", form},
           Case{"C:\\My Meshes\\Cube.STL\r\n", "the name of a file", form},
           Case{"\"v 0 0 0\\nv 1 0 0\\nf 1 1 1\"", "a JSON string", "send the text itself"},
           Case{"dmVydGljZXM6IDAgMCAwLCAxIDAgMCwgMCAxIDAsIGFuZCBmYWNlczogMCAxIDI\nMA==", "base64",
                "decode it"},
           Case{std::string("v\0 \0000\0 \0000\0 \0000\0\n\0", 16), "text in UTF-16", "UTF-8"},
           Case{std::string("\0v\0 \0000\0 \0000\0 \0000\0\n", 16), "text in UTF-16", "UTF-8"},
       }) {
    const Error error = MustRefuse(c.bytes);
    EXPECT_EQ(error.code, ErrorCode::kUnsupportedMeshFormat) << c.what;
    EXPECT_TRUE(error.message.starts_with("the bytes are " + c.what)) << error.message;
    EXPECT_NE(error.message.find(c.advice), std::string::npos) << error.message;
    EXPECT_TRUE(error.message.ends_with("; the formats are obj, ply, stl, off, glb, gltf"))
        << error.message;
  }
}

TEST(MeshReader, SaysThatPointsAloneHaveNoSurface) {
  const std::string xyz = "property float x\nproperty float y\nproperty float z\n";
  const std::string ply = "ply\nformat ascii 1.0\nelement vertex 1\n" + xyz;
  for (const std::string& text : {
           ply + "end_header\n0 0 0\n",
           ply + "element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n",
           std::string("OFF\n1 0 0\n0 0 0\n"),
           std::string("v 0 0 0\nv 1 0 0\np 1 2\n"),
       }) {
    const Error error = MustRefuse(text);
    EXPECT_EQ(error.code, ErrorCode::kEmptyMesh);
    EXPECT_NE(error.message.find("points have no surface"), std::string::npos) << error.message;
  }
}

TEST(MeshReader, SaysThatATextHasLostItsLineBreaks) {
  const std::string facet =
      "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
      "endfacet\n";
  for (std::string text : {
           std::string("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
           std::string("# remark\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
           std::string("mtllib a.mtl\no cube\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
           std::string("remark\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
           std::string("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
           std::string("ply\nformat ascii 1.0\nelement vertex 3\n"),
           std::string("ply\r\ncomment made by hand\r\nformat ascii 1.0\r\n"),
           "solid a\n" + facet + facet + "endsolid a\n",
       }) {
    std::erase_if(text, [](char c) { return c == '\n' || c == '\r'; });
    EXPECT_NE(MustRefuse(text).message.find("--data-binary"), std::string::npos)
        << text << ": " << MustRefuse(text).message;
  }
}

TEST(MeshReader, TellsTextFormatsApartWhateverTheirRemarksSay) {
  const std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  const std::string stl =
      "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
      "endfacet\nendsolid\n";
  EXPECT_EQ(MustRead("$ a solid with facets\n" + obj).format, MeshFormat::kObj);
  EXPECT_EQ(MustRead("# OFF ply solid\n" + obj).format, MeshFormat::kObj);
  EXPECT_EQ(MustRead("// v and f\nsolid\n" + stl).format, MeshFormat::kStl);
  EXPECT_EQ(MustRead("# v 0 0 0\nsolid v 0 0 0\n" + stl).format, MeshFormat::kStl);
  EXPECT_EQ(MustRead("# f 1 2 3\nOFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").format,
            MeshFormat::kOff);
  // Remarks may be long, but not without bound.
  const std::string remarks(500000, '$');
  EXPECT_EQ(MustRead(remarks + "\n" + obj).format, MeshFormat::kObj);
  EXPECT_EQ(MustRefuse(remarks + remarks + remarks + "\n" + obj).code,
            ErrorCode::kUnsupportedMeshFormat);
}

TEST(MeshReader, CallsNoBytesAndOnlyCommentsEmpty) {
  for (const char* text : {"", "\n\n", "# nothing\n", "\xef\xbb\xbf"}) {
    EXPECT_EQ(MustRefuse(text).code, ErrorCode::kEmptyMesh);
  }
}

TEST(MeshReader, StopsWhenAsked) {
  std::string obj = "v 0 0 0\n";
  std::string off = "OFF\n1 20000 0\n0 0 0\n";
  std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nproperty int y\nproperty int z\n"
      "element face 20000\nproperty list int int vertex_index\nend_header\n0 0 0\n";
  std::string stl = "solid\n";
  for (int i = 0; i < 20000; ++i) {
    obj += "f 1 1 1\n";
    off += "3 0 0 0\n";
    ply += "3 0 0 0\n";
    stl +=
        "facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet\n";
  }
  const std::string binary =
      std::string(80, ' ') + Raw<std::uint32_t>(20000) + std::string(std::size_t{50} * 20000, '\0');
  MeshReadOptions cancelled;
  cancelled.cancel = CancelToken::Cancellable();
  cancelled.cancel.Cancel();
  MeshReadOptions late;
  late.cancel = CancelToken::WithDeadline(CancelToken::Clock::now());
  for (const std::string& text : {obj, off, ply, stl, binary}) {
    EXPECT_TRUE(ReadText(text).ok());
    const Result<MeshData> stopped = ReadMesh(test::Bytes(text), cancelled);
    ASSERT_FALSE(stopped.ok());
    EXPECT_EQ(stopped.error().code, ErrorCode::kCancelled);
    const Result<MeshData> too_late = ReadMesh(test::Bytes(text), late);
    ASSERT_FALSE(too_late.ok());
    EXPECT_EQ(too_late.error().code, ErrorCode::kDeadlineExceeded);
  }
}

TEST(MeshReader, AnswersRandomDamageWithAMeshOrAnError) {
  const std::string xyz = "property float x\nproperty float y\nproperty double z\n";
  const std::string header = "element vertex 3\n" + xyz +
                             "element other 2\nproperty list uchar short a\nelement face 2\n"
                             "property list uchar int vertex_indices\nend_header\n";
  std::string body;
  for (int i = 0; i < 3; ++i) body += Raw(0.5f) + Raw(1.5f) + Raw(2.5);
  body += std::string("\2\0\0\0\0\0", 6);  // a list of two and an empty one
  for (int face = 0; face < 2; ++face) {
    body += Raw<std::uint8_t>(3);
    for (const int index : {0, 1, 2}) body += Raw<std::int32_t>(index);
  }
  const std::vector<std::string> files = {
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0.2 0.9 0\nf 1 2 3 4\nf -1//2 -2//1 \\\n-3\n# f\n",
      "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n.1 1e-1 0 # c\n4 0 1 2 3 0.5\n3 0 1 2\n",
      "ply\nformat ascii 1.0\n" + header + "0 0 0\n1 0 0\n0 1 0\n0\n2 1 1\n3 0 1 2\n4 0 1 2 1\n",
      "ply\nformat binary_little_endian 1.0\n" + header + body,
      "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
      "endfacet\nendsolid a\n",
      std::string(80, 'h') + Raw<std::uint32_t>(2) + std::string(100, '\1'),
  };
  for (const std::string& text : files) MustRead(text);
  std::mt19937_64 random = test::RandomEngine(50);
  const std::string letters = "0123456789-+.e/#\\ \n\r\t\"fv";
  int read = 0;
  for (int round = 0; round < 60000; ++round) {
    std::string text = files[static_cast<std::size_t>(round) % files.size()];
    for (int change = 0; change < 1 + round % 4; ++change) {
      const std::size_t at = random() % text.size();
      switch (random() % 5) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text[at] = letters[random() % letters.size()];
          break;
        case 2:
          text.erase(at, 1 + random() % 8);
          break;
        case 3:
          text.insert(at, text.substr(random() % text.size(), random() % 16));
          break;
        default:
          text.insert(at, 1, letters[random() % letters.size()]);
          break;
      }
      if (text.empty()) break;
    }
    const std::vector<std::byte> bytes = test::Bytes(text);
    const Result<MeshData> data = ReadMesh(bytes);
    if (!data.ok()) {
      ASSERT_FALSE(data.error().message.empty());
      continue;
    }
    ++read;
    ASSERT_FALSE(data->triangles.empty());
    for (const TriangleIndices& triangle : data->triangles) {
      for (const std::uint32_t index : triangle) ASSERT_LT(index, data->vertices.size());
    }
    static_cast<void>(TriangleMesh::Create(*data));
  }
  EXPECT_GT(read, 4000);
}

TEST(MeshReader, ReadsTheGoodFilesOfTheCollection) {
  KDRAY_NEED_MESHES();
  int read = 0;
  for (const test::CsvRow& row : test::ReadCsv(*test::MeshFolder() / "MANIFEST.csv")) {
    const std::string& file = row.at("file");
    SCOPED_TRACE(file);
    const std::vector<std::byte> bytes = test::ReadFileBytes(*test::MeshFolder() / file);
    const Result<TriangleMesh> mesh = ReadAndCheck(bytes);
    ++read;
    ASSERT_TRUE(mesh.ok()) << mesh.error().message;
    EXPECT_EQ(Name(mesh->format()), row.at("format"));
    EXPECT_EQ(std::to_string(mesh->triangle_count()), row.at("triangles"));
    EXPECT_EQ(std::to_string(mesh->vertex_count()), row.at("vertices_in_file"));
    // The collection's bounds are those of floats, with 9 digits.
    const double tolerance =
        0x1p-23 * std::max(MaxAbs(mesh->bounds().min), MaxAbs(mesh->bounds().max));
    for (int axis = 0; axis < 3; ++axis) {
      const std::string letter(1, "xyz"[axis]);
      EXPECT_NEAR(mesh->bounds().min[axis], std::stod(row.at("min" + letter)), tolerance);
      EXPECT_NEAR(mesh->bounds().max[axis], std::stod(row.at("max" + letter)), tolerance);
    }
  }
  EXPECT_GT(read, 80);
}

TEST(MeshReader, AnswersTheBadFilesOfTheCollectionAsExpected) {
  KDRAY_NEED_MESHES();
  const std::filesystem::path folder = *test::MeshFolder() / "bad";
  int accepted = 0;
  int refused = 0;
  for (const test::CsvRow& row : test::ReadCsv(folder / "EXPECT.csv")) {
    const std::string& file = row.at("file");
    SCOPED_TRACE(file + ": " + row.at("why"));
    const Result<TriangleMesh> mesh = ReadAndCheck(test::ReadFileBytes(folder / file));
    ++(mesh.ok() ? accepted : refused);
    if (!mesh.ok()) {
      const ErrorCode code = mesh.error().code;
      EXPECT_TRUE(code == ErrorCode::kInvalidMesh || code == ErrorCode::kEmptyMesh ||
                  code == ErrorCode::kUnsupportedMeshFormat);
      EXPECT_FALSE(mesh.error().message.empty());
    }
    if (row.at("expect") == "accept") {
      EXPECT_TRUE(mesh.ok()) << mesh.error().message;
    } else if (row.at("expect") == "reject") {
      EXPECT_FALSE(mesh.ok());
    }
    if (mesh.ok() && !row.at("triangles").empty()) {
      EXPECT_EQ(std::to_string(mesh->triangle_count()), row.at("triangles"));
    }
  }
  EXPECT_GT(accepted, 70);
  EXPECT_GT(refused, 100);
}

TEST(MeshReader, AnswersTheReportedFilesOfTheCollectionAsExpected) {
  KDRAY_NEED_MESHES();
  const std::filesystem::path folder = *test::MeshFolder() / "reported";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "the collection has no reported files";
  for (const test::CsvRow& row : test::ReadCsv(folder / "EXPECT.csv")) {
    SCOPED_TRACE(row.at("file") + ": " + row.at("why"));
    const Result<TriangleMesh> mesh = ReadAndCheck(test::ReadFileBytes(folder / row.at("file")));
    if (row.at("expect") == "accept") {
      EXPECT_TRUE(mesh.ok()) << mesh.error().message;
    } else if (row.at("expect") == "reject") {
      EXPECT_FALSE(mesh.ok());
    }
    if (mesh.ok() && !row.at("triangles").empty()) {
      EXPECT_EQ(std::to_string(mesh->triangle_count()), row.at("triangles"));
    }
  }
}

// The numeric tests' N19: broken input is refused, and no allocation exceeds twice the body.
struct MemoryUse {
  std::size_t peak = 0;
  std::size_t result = 0;  // the part of it that the answer holds
  bool ok = false;
};

MemoryUse Measure(std::span<const std::byte> bytes, const MeshReadOptions& options = {}) {
  const test::AllocationPeak memory;
  const Result<MeshData> data = ReadMesh(bytes, options);
  return {memory.bytes(), data.ok() ? memory.held() : 0, data.ok()};
}

// For scratch that does not grow with the file: a header's properties, messages, concave polygons.
constexpr std::size_t kSlack = 64 << 10;

void ExpectBounded(std::span<const std::byte> bytes) {
  const MemoryUse use = Measure(bytes);
  SCOPED_TRACE(use.ok ? "read" : "refused");
  EXPECT_LE(use.peak - use.result, 2 * bytes.size() + kSlack);
}

// JSON values take more memory than their text, which is told before it is taken.
void ExpectTold(std::span<const std::byte> bytes) {
  std::uint64_t told = 0;
  MeshReadOptions options;
  options.on_counts = [&](const MeshCounts& counts) -> Status {
    told = counts.ReadBytes();
    return {};
  };
  const MemoryUse use = Measure(bytes, options);
  EXPECT_LE(use.peak, told + kSlack);
}

TEST(N19HostileFiles, RefusesBrokenCountsWithoutTakingMemoryForThem) {
  const std::string ply = "ply\nformat ascii 1.0\n";
  const std::string binary_ply = "ply\nformat binary_little_endian 1.0\n";
  const std::string xyz = "property float x\nproperty float y\nproperty float z\n";
  const std::string list = "property list uint int vertex_indices\n";
  for (const std::string& text : std::vector<std::string>{
           "",
           "v 0 0 0\n",
           "v 0 0 0\nf 1 1 2\n",
           "v 0 0 0\nf 1 1 4294967297\n",
           "OFF\n4294967295 4294967295 0\n0 0 0\n",
           "OFF\n1 1 0\n0 0 0\n4294967295 0 0 0\n",
           "OFF\n1 9223372036854775807 0\n0 0 0\n3 0 0 0\n",
           ply + "element vertex 9223372036854775807\n" + xyz + "element face 1\n" + list +
               "end_header\n0 0 0\n3 0 0 0\n",
           ply + "element vertex 1\n" + xyz + "element face 9223372036854775807\n" + list +
               "end_header\n0 0 0\n3 0 0 0\n",
           ply + "element vertex 1\n" + xyz + "element face 1\n" + list +
               "end_header\n0 0 0\n4294967295 0 0 0\n",
           binary_ply + "element vertex 4294967295\n" + xyz + "element face 1\n" + list +
               "end_header\n" + std::string(100, '\0'),
           binary_ply + "element vertex 1\n" + xyz + "element face 4294967295\n" + list +
               "end_header\n" + std::string(100, '\0'),
           binary_ply + "element vertex 1\n" + xyz + "element face 1\n" + list + "end_header\n" +
               std::string(12, '\0') + std::string(100, '\xff'),
           std::string(80, 'x') + Raw<std::uint32_t>(0xffffffff) + std::string(50, '\0'),
           std::string(80, '\0') + Raw<std::uint32_t>(85899346) + std::string(50, '\0'),
       }) {
    SCOPED_TRACE(text.substr(0, 200));
    const Result<TriangleMesh> mesh = ReadAndCheck(test::Bytes(text));
    ASSERT_FALSE(mesh.ok());
    EXPECT_TRUE(mesh.error().code == ErrorCode::kInvalidMesh ||
                mesh.error().code == ErrorCode::kEmptyMesh);
    ExpectBounded(test::Bytes(text));
  }
}

TEST(N19HostileFiles, TakesAtMostTwiceTheBodyForLiesThatAreAsLargeAsTheFileAllows) {
  // Files of blank lines that claim the most rows their bytes could hold.
  const std::string blanks(1 << 20, '\n');
  const std::string count = std::to_string((1 << 20) / 6 - 100);
  const std::string xyz = "property int x\nproperty int y\nproperty int z\n";
  const std::string list = "property list uchar uchar vertex_indices\n";
  for (const std::string& text : {
           "OFF\n" + count + " 1 0\n" + blanks,
           "OFF\n" + count + " 1 0\n0 0 0\n" + blanks,
           "ply\nformat ascii 1.0\nelement vertex " + count + "\n" + xyz + "element face 1\n" +
               list + "end_header\n" + blanks,
           "ply\nformat binary_little_endian 1.0\nelement vertex " + count +
               "\nproperty list uchar uchar a\nproperty uchar x\nproperty uchar y\nproperty uchar "
               "z\nelement face 1\n" +
               list + "end_header\n" + std::string(1 << 20, '\xff'),
       }) {
    const MemoryUse use = Measure(test::Bytes(text));
    EXPECT_FALSE(use.ok);
    EXPECT_LE(use.peak, 2 * text.size() + kSlack);
  }
}

TEST(N19HostileFiles, TakesAtMostTwiceTheBodyBesideTheResultForDenseFiles) {
  constexpr int kRows = 60000;
  std::string vertices;
  std::string obj_faces;
  std::string faces;
  std::string corners;
  std::string stl = "solid\n";
  std::string raw_faces;
  for (int i = 0; i < kRows; ++i) {
    vertices += "0 0 0\n";
    obj_faces += "v 0 0 0\nf 1 1 1\n";
    faces += "3 0 0 0\n";
    corners += " 1 1";
    stl +=
        "facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet\n";
    raw_faces += std::string("\3\0\0\0", 4);
  }
  const std::string rows = std::to_string(kRows);
  const std::string one_face = std::to_string(2 * kRows) + corners + "\n";
  const auto ply = [&](const std::string& format, const std::string& face_rows) {
    return "ply\nformat " + format + " 1.0\nelement vertex " + rows +
           "\nproperty uchar x\nproperty uchar y\nproperty uchar z\nelement face " + face_rows +
           "\nproperty list int uchar vertex_indices\nend_header\n";
  };
  const auto small_ply = [&](const std::string& format) {
    std::string header = ply(format, rows);
    return header.replace(header.find("list int"), 8, "list uchar");
  };
  for (const std::string& text : {
           obj_faces,
           "v 0 0 0\nf" + corners,
           "OFF\n" + rows + " " + rows + " 0\n" + vertices + faces,
           "OFF\n" + rows + " 1 0\n" + vertices + one_face,
           ply("ascii", rows) + vertices + faces,
           ply("ascii", "1") + vertices + one_face,
           small_ply("binary_little_endian") + std::string(3 * kRows, '\0') + raw_faces,
           std::string(80, ' ') + Raw<std::uint32_t>(kRows) +
               std::string(std::size_t{50} * kRows, '\0'),
           stl,
       }) {
    SCOPED_TRACE(text.substr(0, 60));
    ASSERT_TRUE(ReadText(text).ok());
    ExpectBounded(test::Bytes(text));
  }
}

TEST(N19HostileFiles, KeepsItsBoundOnTheWholeCollection) {
  KDRAY_NEED_MESHES();
  for (const std::filesystem::path& folder :
       {*test::MeshFolder(), *test::MeshFolder() / "bad", *test::MeshFolder() / "reported"}) {
    if (!std::filesystem::exists(folder)) continue;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
      if (!entry.is_regular_file()) continue;
      SCOPED_TRACE(entry.path().filename().string());
      const std::vector<std::byte> bytes = test::ReadFileBytes(entry.path());
      const std::string ending = entry.path().extension().string();
      if (ending == ".glb" || ending == ".gltf") {
        ExpectTold(bytes);
      } else {
        ExpectBounded(bytes);
      }
    }
  }
}

}  // namespace
}  // namespace kdray::core
