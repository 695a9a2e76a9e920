// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_container.h"

#include <string>

#include "core/io/mesh_error.h"
#include "core/io/parse_text.h"

namespace kdray::core {
namespace {

constexpr std::string_view kMagic = "glTF";

std::uint32_t LoadUint32(std::span<const std::byte> bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value |= static_cast<std::uint32_t>(bytes[offset + i]) << (8 * i);
  }
  return value;
}

// A GLB file: magic, version, length, and chunks with a length, a type and bytes. The first is
// JSON; the second may be BIN; others are skipped.
Result<GltfContainer> OpenGlb(std::span<const std::byte> bytes) {
  constexpr std::size_t kHeader = 12;
  constexpr std::size_t kChunkHeader = 8;
  constexpr std::uint32_t kJson = 0x4e4f534a;
  constexpr std::uint32_t kBin = 0x004e4942;
  if (bytes.size() < kHeader) return AtByte(bytes.size(), "a GLB file has at least 12 bytes");
  if (const std::uint32_t version = LoadUint32(bytes, 4); version != 2) {
    return AtByte(4, "a GLB file of version " + std::to_string(version) + "; version 2 is read");
  }
  const std::uint32_t length = LoadUint32(bytes, 8);
  if (length > bytes.size() || length < kHeader) {
    return AtByte(8, "the GLB file says that it has " + std::to_string(length) + " bytes; it has " +
                         std::to_string(bytes.size()));
  }
  bytes = bytes.first(length);
  GltfContainer container;
  container.is_glb = true;
  std::size_t offset = kHeader;
  for (int chunk = 0; chunk < 2 && offset < bytes.size(); ++chunk) {
    if (bytes.size() - offset < kChunkHeader) {
      return AtByte(offset, "the GLB file ends in the head of a chunk");
    }
    const std::uint32_t size = LoadUint32(bytes, offset);
    const std::uint32_t type = LoadUint32(bytes, offset + 4);
    if (size > bytes.size() - offset - kChunkHeader) {
      return AtByte(offset, "a chunk of " + std::to_string(size) + " bytes does not fit into the " +
                                std::to_string(bytes.size() - offset - kChunkHeader) +
                                " bytes that follow");
    }
    const auto content = bytes.subspan(offset + kChunkHeader, size);
    if (chunk == 0 && type == kJson) {
      container.json = {reinterpret_cast<const char*>(content.data()), content.size()};
      container.json_begin = offset + kChunkHeader;
    } else if (chunk == 1 && type == kBin) {
      container.binary = content;
    }
    offset += kChunkHeader + size;
  }
  if (container.json.empty()) return AtByte(kHeader, "the first chunk of the GLB file is not JSON");
  return container;
}

}  // namespace

bool IsGlb(std::string_view bytes) { return bytes.starts_with(kMagic); }

bool BeginsAsJsonObject(std::string_view bytes) {
  constexpr std::size_t kLookBytes = std::size_t{1} << 16;
  const std::string_view text = SkipByteOrderMark(bytes).substr(0, kLookBytes);
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  return first != std::string_view::npos && text[first] == '{';
}

Result<GltfContainer> OpenGltf(std::span<const std::byte> bytes, CancelPoll* poll) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (IsGlb(text)) return OpenGlb(bytes);
  const std::string_view json = SkipByteOrderMark(text);
  return GltfContainer{false, WithoutPadding(json, poll), text.size() - json.size(), std::nullopt};
}

}  // namespace kdray::core
