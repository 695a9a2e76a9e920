// SPDX-License-Identifier: Apache-2.0
// Undoes the content codings of uploads, piece by piece: gzip (zlib) and zstd (libzstd). Its .cc is
// the only file that includes these libraries here. Sources: RFC 1952 (gzip), RFC 8878 (zstd).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "api/types.h"

namespace kdray::server {

enum class ContentCoding : std::uint8_t { kGzip, kZstd };

/// The coding that a Content-Encoding names (RFC 9110, 8.4.1: x-gzip is gzip); nullopt for another.
std::optional<ContentCoding> ParseContentCoding(std::string_view name);

/// Decodes one body. It accepts several gzip members or zstd frames in a row, and skippable frames.
/// Used by one thread.
class ContentDecoder {
 public:
  /// zstd frames may refer to this many bytes before (RFC 9659).
  static constexpr std::uint64_t kMaxWindowBytes = std::uint64_t{8} << 20;
  /// More than this many bytes of input are never needed to continue.
  static constexpr std::size_t kLeastInputBytes = 4;

  static std::unique_ptr<ContentDecoder> Make(ContentCoding coding);
  virtual ~ContentDecoder() = default;

  struct Step {
    std::size_t taken = 0;  ///< bytes of `in`
    std::size_t made = 0;   ///< bytes of `out`
  };
  /// Decodes until `in` is used up or `out` is full. It may leave fewer than kLeastInputBytes of
  /// `in`, unless `is_last`: no input follows. Call it again while `out` was filled. Errors:
  /// malformed_request for a damaged stream and for bytes after its end, unsupported_encoding for a
  /// zstd frame whose window is larger than kMaxWindowBytes or that needs a dictionary, memory_full
  /// if there is no memory for it.
  virtual api::Outcome<Step> Decode(std::span<const std::byte> in, bool is_last,
                                    std::span<std::byte> out) = 0;
  /// Whether the input may end here: after a whole member or frame.
  virtual bool is_complete() const = 0;
  /// The coding's name, for error texts.
  virtual std::string_view name() const = 0;
  /// Memory that it has taken after `decoded` bytes, at most.
  virtual std::uint64_t MemoryBytes(std::uint64_t decoded) const = 0;
};

}  // namespace kdray::server
