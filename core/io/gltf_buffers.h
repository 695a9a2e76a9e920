// SPDX-License-Identifier: Apache-2.0
// The bytes of a glTF file's buffer views: where they are, base64 decoded, and compressed ones
// (core/io/meshopt_decoder.h) too.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/io/gltf_document.h"

namespace kdray::core {

/// "/accessors/3".
std::string GltfPointer(std::string_view list, std::uint64_t number);

/// For one thread at a time.
class GltfBuffers {
 public:
  /// `binary`: the GLB's BIN chunk; nullopt without one. All must outlive this.
  GltfBuffers(const GltfDocument& document, std::optional<std::span<const std::byte>> binary,
              CancelPoll* poll);

  /// Who uses a view, for errors.
  struct User {
    std::string pointer;
    bool is_needed = false;  ///< the mesh is invalid without it
  };
  /// Whether the view, or what it is compressed to, lies in a buffer whose bytes are in the file.
  /// It will be decoded.
  /// kInvalidMesh with the JSON pointer.
  Status Use(std::uint64_t view, const User& user);

  /// The memory that Decode takes, at most.
  std::uint64_t DecodedBytes() const;
  /// Decodes what is used. kInvalidMesh if it is not what it claims and somebody needs it; else Use
  /// fails from then on. Errors of the poll.
  Status Decode();
  /// Of a view that is used, after Decode.
  std::span<const std::byte> Bytes(std::uint64_t view) const;

 private:
  Status UseBytes(std::uint64_t buffer, std::uint64_t offset, std::uint64_t bytes,
                  const User& user);
  Status UseBuffer(std::uint64_t number, bool is_needed);
  Status UseCompressed(std::uint64_t view, const User& user);
  Status DecodeBuffer(std::uint64_t number);
  Status DecodeView(std::uint64_t number);

  struct Buffer {
    bool is_used = false;
    bool is_needed = false;
    bool is_broken = false;  // found when it was decoded
    std::span<const std::byte> bytes;
    std::vector<std::byte> decoded;
  };

  struct CompressedView {
    bool is_needed = false;
    bool is_broken = false;
    std::vector<std::byte> decoded;
  };

  const GltfDocument& document_;
  std::optional<std::span<const std::byte>> binary_;
  CancelPoll* poll_;
  std::vector<Buffer> buffers_;
  std::map<std::uint64_t, CompressedView> compressed_;  // those that are used, by number
};

}  // namespace kdray::core
