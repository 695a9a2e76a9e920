#include "core/io/stl_reader.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/cancel_poll.h"
#include "core/io/mesh_error.h"
#include "core/io/parse_text.h"

namespace kdray::core {
namespace {

// A binary file: 80 bytes of anything, the number of triangles, and for each the normal, three
// corners and two bytes of attributes, all little-endian.
constexpr std::size_t kHeaderBytes = 80;
constexpr std::size_t kFirstRecord = 84;
constexpr std::size_t kRecordBytes = 50;
constexpr std::size_t kNormalBytes = 12;

std::uint32_t LoadUint32(std::span<const std::byte> bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value |= static_cast<std::uint32_t>(bytes[offset + i]) << (8 * i);
  }
  return value;
}

std::uint64_t BinarySize(std::span<const std::byte> bytes) {
  return kFirstRecord + std::uint64_t{kRecordBytes} * LoadUint32(bytes, kHeaderBytes);
}

void AppendTriangle(MeshData* data) {
  const auto end = static_cast<std::uint32_t>(data->vertices.size());
  data->triangles.push_back({end - 3, end - 2, end - 1});
}

Error TooLarge(std::uint64_t triangles) {
  return Error{ErrorCode::kMeshTooLarge, "the STL file has " + std::to_string(triangles) +
                                             " triangles; at most " +
                                             std::to_string(kMaxTriangles) + " are allowed"};
}

Result<MeshData> ReadBinary(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  const std::uint32_t count = LoadUint32(bytes, kHeaderBytes);
  if (count == 0) return Error{ErrorCode::kEmptyMesh, "the STL file has no triangle"};
  if (count > kMaxTriangles) return TooLarge(count);
  MeshData data;
  data.format = MeshFormat::kStl;
  data.single_precision = true;
  data.vertices.reserve(3 * std::size_t{count});
  data.triangles.reserve(count);
  CancelPoll cancel(options.cancel);
  for (std::size_t record = kFirstRecord; record < bytes.size(); record += kRecordBytes) {
    if (cancel.Spend(64)) return cancel.ToError();
    std::size_t offset = record + kNormalBytes;
    for (int corner = 0; corner < 3; ++corner) {
      Vec3f vertex;
      for (int axis = 0; axis < 3; ++axis, offset += 4) {
        vertex[axis] = std::bit_cast<float>(LoadUint32(bytes, offset));
        if (!std::isfinite(vertex[axis])) return AtByte(offset, "a coordinate is not finite");
      }
      data.vertices.push_back(Vec3d(vertex));
    }
    AppendTriangle(&data);
  }
  return data;
}

class AsciiReader {
 public:
  AsciiReader(std::string_view text, const MeshReadOptions& options)
      : cursor_(text, {}), cancel_(options.cancel) {
    data_.format = MeshFormat::kStl;
    // No facet is shorter, so this is room enough, about as many bytes as the file has.
    constexpr std::string_view kShortestFacet =
        "facet normal 0 0 0 outer loop vertex 0 0 0 vertex 0 0 0 vertex 0 0 0 endloop endfacet ";
    const std::size_t most = (text.size() + 1) / kShortestFacet.size();
    data_.vertices.reserve(3 * std::min(most, kMaxTriangles));
    data_.triangles.reserve(std::min(most, kMaxTriangles));
  }

  Result<MeshData> Read() {
    for (;;) {
      if (cancel_.Spend(64)) return cancel_.ToError();
      const std::uint64_t line_before = cursor_.line();
      const std::string_view word = NextWord();
      if (word.empty()) break;
      if (EqualsIgnoringCase(word, "facet")) {
        if (Status status = ReadFacet(); !status.ok()) return std::move(status).error();
      } else if (EqualsIgnoringCase(word, "solid") || EqualsIgnoringCase(word, "endsolid")) {
        SkipName();
      } else if (cursor_.line() != line_before) {
        return AtLine(cursor_.line(), Quoted(word) + " begins no statement of an STL file");
      }
    }
    if (data_.triangles.empty()) {
      return Error{ErrorCode::kEmptyMesh, "the STL file has no facet"};
    }
    return std::move(data_);
  }

 private:
  // The next word on this or a later line; empty at the end of the file.
  std::string_view NextWord() {
    for (;;) {
      const std::string_view word = cursor_.NextWord();
      if (!word.empty() || cursor_.AtEnd()) return word;
      cursor_.NextLine();
    }
  }

  // A name ends with its line, or, when all stands on one line, where a facet begins.
  void SkipName() {
    for (;;) {
      TextCursor ahead = cursor_;
      const std::string_view word = ahead.NextWord();
      if (word.empty()) return;
      if (EqualsIgnoringCase(word, "facet") && EqualsIgnoringCase(ahead.NextWord(), "normal")) {
        return;
      }
      cursor_.NextWord();
    }
  }

  static bool IsKeyword(std::string_view word) {
    static constexpr std::array<std::string_view, 9> kKeywords = {
        "solid", "facet", "normal", "outer", "loop", "vertex", "endloop", "endfacet", "endsolid"};
    return std::any_of(kKeywords.begin(), kKeywords.end(),
                       [&](std::string_view k) { return EqualsIgnoringCase(word, k); });
  }

  // Passes the keyword that must come next. Other words are allowed before it on the line of the
  // statement before: the numbers of a normal, or remarks.
  Status Expect(std::string_view keyword) {
    const std::uint64_t line_before = cursor_.line();
    for (;;) {
      const std::string_view word = NextWord();
      if (EqualsIgnoringCase(word, keyword)) return {};
      if (word.empty()) {
        return AtLine(cursor_.line(), "the file ends where '" + std::string(keyword) + "' must be");
      }
      if (cursor_.line() != line_before || IsKeyword(word)) {
        return AtLine(cursor_.line(),
                      Quoted(word) + " where '" + std::string(keyword) + "' must be");
      }
    }
  }

  Status ReadFacet() {
    if (data_.triangles.size() == kMaxTriangles) return TooLarge(kMaxTriangles + 1);
    for (const std::string_view keyword : {"normal", "outer", "loop"}) {
      if (Status status = Expect(keyword); !status.ok()) return status;
    }
    for (int corner = 0; corner < 3; ++corner) {
      if (Status status = Expect("vertex"); !status.ok()) return status;
      Vec3d vertex;
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = cursor_.NextWord();
        const std::optional<double> number = ParseNumber(word);
        if (!number) return AtLine(cursor_.line(), WhyNotNumber(word));
        vertex[axis] = *number;
      }
      data_.vertices.push_back(vertex);
    }
    AppendTriangle(&data_);
    if (Status status = Expect("endloop"); !status.ok()) return status;
    return Expect("endfacet");
  }

  TextCursor cursor_;
  CancelPoll cancel_;
  MeshData data_;
};

}  // namespace

bool HasBinaryStlSize(std::span<const std::byte> bytes) {
  return bytes.size() >= kFirstRecord && bytes.size() == BinarySize(bytes);
}

Result<MeshData> ReadStl(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  if (HasBinaryStlSize(bytes)) return ReadBinary(bytes, options);
  const std::string_view text = SkipByteOrderMark(
      std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  TextCursor cursor(text, {});
  const bool is_solid =
      cursor.FindLineWithWords() && EqualsIgnoringCase(cursor.NextWord(), "solid");
  if (is_solid && text.substr(0, kFirstRecord).find('\0') == std::string_view::npos) {
    return AsciiReader(text, options).Read();
  }
  if (bytes.size() < kFirstRecord) {
    return AtByte(bytes.size(), "a binary STL file has at least 84 bytes");
  }
  return AtByte(kHeaderBytes, "as a binary STL, with a count of " +
                                  std::to_string(LoadUint32(bytes, kHeaderBytes)) +
                                  " triangles, the file would have " +
                                  std::to_string(BinarySize(bytes)) + " bytes; it has " +
                                  std::to_string(bytes.size()));
}

}  // namespace kdray::core
