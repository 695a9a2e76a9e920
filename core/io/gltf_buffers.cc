// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_buffers.h"

#include <array>

#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

// The value of a base64 digit; 64 for any other character.
constexpr std::array<std::uint8_t, 256> kDigits = [] {
  std::array<std::uint8_t, 256> digits{};
  digits.fill(64);
  constexpr std::string_view kAlphabet =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (std::size_t i = 0; i < kAlphabet.size(); ++i) {
    digits[static_cast<unsigned char>(kAlphabet[i])] = static_cast<std::uint8_t>(i);
  }
  return digits;
}();

// Appends at most `bytes` bytes of base64 text to `out`. JSON may escape a slash; nothing else
// needs an escape. False at a character that is not base64, or when the poll stops.
bool DecodeBase64(std::string_view text, std::uint64_t bytes, std::vector<std::byte>* out,
                  CancelPoll* poll) {
  while (text.ends_with('=')) text.remove_suffix(1);
  std::uint32_t bits = 0;
  int count = 0;
  bool is_valid = true;
  const bool done = PolledLoop(text.size(), 4, poll, [&](std::size_t i) {
    if (text[i] == '\\' && i + 1 < text.size() && text[i + 1] == '/') return;
    const std::uint8_t digit = kDigits[static_cast<unsigned char>(text[i])];
    is_valid = is_valid && digit < 64;
    bits = bits << 6 | digit;
    if ((count += 6) < 8) return;
    count -= 8;
    if (out->size() < bytes) out->push_back(static_cast<std::byte>(bits >> count & 0xff));
  });
  return done && is_valid;
}

std::string MeshoptPointer(std::uint64_t view) {
  return GltfPointer("bufferViews", view) + "/extensions/EXT_meshopt_compression";
}

}  // namespace

std::string GltfPointer(std::string_view list, std::uint64_t number) {
  return "/" + std::string(list) + "/" + std::to_string(number);
}

GltfBuffers::GltfBuffers(const GltfDocument& document,
                         std::optional<std::span<const std::byte>> binary, CancelPoll* poll)
    : document_(document), binary_(binary), poll_(poll), buffers_(document.buffers.size()) {}

Status GltfBuffers::Use(std::uint64_t number, const User& user) {
  if (number >= document_.views.size()) {
    return AtPointer(user.pointer, "the bufferView " + std::to_string(number) +
                                       " does not exist; the file has " +
                                       std::to_string(document_.views.size()));
  }
  const GltfView& view = document_.views[number];
  const User of_view{GltfPointer("bufferViews", number), user.is_needed};
  if (view.meshopt) return UseCompressed(number, of_view);
  return UseBytes(view.buffer, view.offset, view.bytes, of_view);
}

Status GltfBuffers::UseBytes(std::uint64_t buffer, std::uint64_t offset, std::uint64_t bytes,
                             const User& user) {
  if (buffer >= document_.buffers.size()) {
    return AtPointer(user.pointer, "the buffer " + std::to_string(buffer) +
                                       " does not exist; the file has " +
                                       std::to_string(document_.buffers.size()));
  }
  const std::uint64_t available = document_.buffers[buffer].bytes;
  if (offset > available || bytes > available - offset) {
    return AtPointer(user.pointer, std::to_string(bytes) + " bytes from byte " +
                                       std::to_string(offset) + " on do not fit into the " +
                                       std::to_string(available) + " bytes of buffer " +
                                       std::to_string(buffer));
  }
  return UseBuffer(buffer, user.is_needed);
}

// The view's own buffer need not have data: it is for readers that do not know the extension.
Status GltfBuffers::UseCompressed(std::uint64_t number, const User& user) {
  if (const auto used = compressed_.find(number); used != compressed_.end()) {
    if (used->second.is_broken) return AtPointer(user.pointer, "is broken");
    used->second.is_needed = used->second.is_needed || user.is_needed;
    return UseBuffer(document_.views[number].meshopt->buffer, user.is_needed);
  }
  const GltfView& view = document_.views[number];
  const GltfMeshopt& meshopt = *view.meshopt;
  const User of_meshopt{MeshoptPointer(number), user.is_needed};
  Status status = UseBytes(meshopt.buffer, meshopt.offset, meshopt.bytes, of_meshopt);
  if (!status.ok()) return status;
  if (const std::optional<std::string> why = WhyNotMeshopt(meshopt.form, meshopt.bytes)) {
    return AtPointer(of_meshopt.pointer, *why);
  }
  if (meshopt.form.Bytes() != view.bytes) {
    return AtPointer(user.pointer, "has a byteLength of " + std::to_string(view.bytes) + "; " +
                                       std::to_string(meshopt.form.count) + " elements of " +
                                       std::to_string(meshopt.form.stride) +
                                       " bytes are compressed in it");
  }
  if (view.stride != 0 && view.stride != meshopt.form.stride) {
    return AtPointer(user.pointer, "has a byteStride of " + std::to_string(view.stride) +
                                       ", its compressed data of " +
                                       std::to_string(meshopt.form.stride));
  }
  compressed_[number].is_needed = user.is_needed;
  return {};
}

Status GltfBuffers::UseBuffer(std::uint64_t number, bool is_needed) {
  Buffer& used = buffers_[number];
  if (used.is_broken) return AtPointer(GltfPointer("buffers", number), "is broken");
  used.is_needed = used.is_needed || is_needed;
  if (used.is_used) return {};
  const GltfBuffer& buffer = document_.buffers[number];
  const std::string pointer = GltfPointer("buffers", number);
  if (!buffer.other_uri.empty()) {
    return AtPointer(pointer, "the data is in another file, " + Quoted(buffer.other_uri) +
                                  "; only embedded buffers are read: send a GLB, or a glTF whose "
                                  "buffers are base64 in data: URIs");
  }
  std::uint64_t available = 0;
  if (buffer.data_uri) {
    available = buffer.data_uri->size() / 4 * 3 + 3;
  } else if (number == 0 && binary_) {
    available = binary_->size();
  } else {
    return AtPointer(pointer, "has no 'uri', and the file has no BIN chunk for it");
  }
  if (buffer.bytes > available) {
    return AtPointer(pointer, "claims " + std::to_string(buffer.bytes) +
                                  " bytes; the file has at most " + std::to_string(available) +
                                  " for it");
  }
  used.is_used = true;
  return {};
}

std::uint64_t GltfBuffers::DecodedBytes() const {
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < buffers_.size(); ++i) {
    const GltfBuffer& buffer = document_.buffers[i];
    if (buffers_[i].is_used && buffer.data_uri) bytes += buffer.bytes;
  }
  for (const auto& [number, view] : compressed_) bytes += document_.views[number].bytes;
  return bytes;
}

Status GltfBuffers::Decode() {
  for (std::size_t i = 0; i < buffers_.size(); ++i) {
    Buffer& buffer = buffers_[i];
    if (!buffer.is_used) continue;
    Status status = DecodeBuffer(i);
    if (status.ok()) continue;
    if (buffer.is_needed || poll_->stopped()) return status;
    buffer.is_broken = true;
  }
  for (auto& [number, view] : compressed_) {
    Status status = DecodeView(number);
    if (status.ok()) continue;
    if (view.is_needed || poll_->stopped()) return status;
    view.is_broken = true;
  }
  return {};
}

Status GltfBuffers::DecodeBuffer(std::uint64_t number) {
  const GltfBuffer& buffer = document_.buffers[number];
  Buffer& used = buffers_[number];
  if (!buffer.data_uri) {
    used.bytes = binary_->subspan(0, buffer.bytes);
    return {};
  }
  constexpr std::string_view kBase64 = ";base64,";
  const std::string pointer = GltfPointer("buffers", number);
  constexpr std::size_t kLongestType = 256;
  const std::size_t found = buffer.data_uri->substr(0, kLongestType).find(kBase64);
  if (found == std::string_view::npos) {
    return AtPointer(pointer, "a data: URI must say ';base64,'");
  }
  used.decoded.reserve(buffer.bytes);
  const std::string_view text = buffer.data_uri->substr(found + kBase64.size());
  const bool is_valid = DecodeBase64(text, buffer.bytes, &used.decoded, poll_);
  if (poll_->stopped()) return poll_->ToError();
  if (!is_valid) return AtPointer(pointer, "the data: URI is not valid base64");
  if (used.decoded.size() < buffer.bytes) {
    return AtPointer(pointer, "claims " + std::to_string(buffer.bytes) +
                                  " bytes; the data: URI has " +
                                  std::to_string(used.decoded.size()));
  }
  used.bytes = used.decoded;
  return {};
}

Status GltfBuffers::DecodeView(std::uint64_t number) {
  const GltfMeshopt& meshopt = *document_.views[number].meshopt;
  const std::string pointer = MeshoptPointer(number);
  if (buffers_[meshopt.buffer].is_broken) return AtPointer(pointer, "its buffer is broken");
  std::vector<std::byte>& decoded = compressed_[number].decoded;
  decoded.resize(meshopt.form.Bytes());
  Status status = DecodeMeshopt(
      meshopt.form, buffers_[meshopt.buffer].bytes.subspan(meshopt.offset, meshopt.bytes), decoded,
      poll_);
  if (status.ok() || poll_->stopped()) return status;
  return AtPointer(pointer, status.error().message);
}

std::span<const std::byte> GltfBuffers::Bytes(std::uint64_t number) const {
  const GltfView& view = document_.views[number];
  if (view.meshopt) return compressed_.at(number).decoded;
  return buffers_[view.buffer].bytes.subspan(view.offset, view.bytes);
}

}  // namespace kdray::core
