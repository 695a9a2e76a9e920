#include "core/io/mesh_reader.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <string_view>

#include "core/io/obj_reader.h"
#include "core/io/off_reader.h"
#include "core/io/parse_text.h"
#include "core/io/ply_reader.h"
#include "core/io/stl_reader.h"

namespace kdray::core {
namespace {

using Reader = Result<MeshData> (*)(std::span<const std::byte>, const MeshReadOptions&);

// First bytes of files that people may take for a mesh of ours, so that the answer can say what
// they are.
struct Signature {
  std::string_view bytes;
  std::string_view name;
};
constexpr std::array<Signature, 19> kOtherFiles = {{
    {"glTF", "a GLB file"},
    {"\x1f\x8b", "gzip data"},
    {"PK\x03\x04", "a ZIP archive"},
    {"BZh", "bzip2 data"},
    {"\xfd"
     "7zXZ",
     "xz data"},
    {"\x28\xb5\x2f\xfd", "Zstandard data"},
    {"7z\xbc\xaf", "a 7-Zip archive"},
    {"Kaydara FBX Binary", "an FBX file"},
    {"BLENDER", "a Blender file"},
    {"PXR-USDC", "a USD file"},
    {"#usda", "a USD file"},
    {"#VRML", "a VRML file"},
    {"ISO-10303-21", "a STEP file"},
    {"\x93NUMPY", "an array of NumPy"},
    {"\x89PNG", "a PNG picture"},
    {"\xff\xd8\xff", "a JPEG picture"},
    {"%PDF", "a PDF document"},
    {"\xfe\xff", "text in UTF-16, not UTF-8"},
    {"\xff\xfe", "text in UTF-16, not UTF-8"},
}};

Error Unsupported(std::string_view what) {
  return Error{ErrorCode::kUnsupportedMeshFormat,
               "the bytes are " + std::string(what) + "; the formats are obj, ply, stl, off"};
}

bool IsCount(std::string_view word) {
  const std::optional<std::int64_t> number = ParseInteger(word);
  return number && *number >= 0;
}

// What the first statement of the text says, `cursor` in front of it.
Reader FindTextFormat(TextCursor cursor) {
  const std::string_view first = cursor.NextWord();
  if (EqualsIgnoringCase(first, "solid")) return ReadStl;
  if (IsOffKeyword(first)) return ReadOff;
  if (IsObjKeyword(first)) return ReadObj;
  // OFF without its keyword begins with three counts.
  if (IsCount(first) && IsCount(cursor.NextWord()) && IsCount(cursor.NextWord()) &&
      cursor.NextWord().empty()) {
    return ReadOff;
  }
  return nullptr;
}

// Bytes that are in no text in UTF-8.
bool IsBinary(std::string_view bytes) {
  return std::any_of(bytes.begin(), bytes.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte >= 0xf8 || (byte < ' ' && (byte < '\t' || byte > '\r'));
  });
}

}  // namespace

Result<MeshData> ReadMesh(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  if (bytes.empty()) return Error{ErrorCode::kEmptyMesh, "the mesh has no bytes"};
  // Before anything else, because the header of a binary STL may read like any other format.
  if (HasBinaryStlSize(bytes)) return ReadStl(bytes, options);

  const std::string_view all(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  for (const Signature& other : kOtherFiles) {
    if (all.starts_with(other.bytes)) return Unsupported(other.name);
  }
  const std::string_view text = SkipByteOrderMark(all);
  if (text.starts_with("ply") && (text.size() == 3 || text[3] <= ' '))
    return ReadPly(bytes, options);

  TextCursor cursor(text, {.hash_comments = true});
  if (!cursor.FindLineWithWords()) {
    return Error{ErrorCode::kEmptyMesh, "the mesh holds nothing but blanks and comments"};
  }
  if (const Reader reader = FindTextFormat(cursor)) return reader(bytes, options);
  if (cursor.NextWord().starts_with('{')) return Unsupported("JSON, perhaps a glTF file");
  // What is no text, and not known otherwise, can only be a binary STL whose count is wrong.
  if (IsBinary(all.substr(0, 84)) && all.size() >= 84) return ReadStl(bytes, options);
  return Unsupported("of no format that is known here");
}

}  // namespace kdray::core
