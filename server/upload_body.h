// SPDX-License-Identifier: Apache-2.0
// The body of an upload: its bytes after Content-Encoding is undone, under the limits of both.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "api/types.h"
#include "server/content_decoder.h"
#include "server/http/message.h"
#include "server/request_memory.h"

namespace kdray::server {

/// Reads a body from its connection. A body without a coding passes through unchanged. Used by one
/// thread.
class UploadBody {
 public:
  /// A body may decode to kMaxRatio times its encoded size and kRatioSlackBytes more.
  static constexpr std::uint64_t kMaxRatio = 200;
  static constexpr std::uint64_t kRatioSlackBytes = std::uint64_t{1} << 20;
  /// Encoded bytes are read in pieces of this size. The ratio counts those that have been read, so
  /// a body up to this size is judged as a whole.
  static constexpr std::size_t kEncodedPieceBytes = 256 * 1024;

  /// `max_bytes` limits the decoded bytes. Memory for decoding is charged to `memory` as bytes are
  /// decoded. `peer` and `memory` must outlive this.
  UploadBody(HttpPeer* peer, RequestMemory* memory, std::optional<ContentCoding> coding,
             std::uint64_t max_bytes);

  /// mesh_too_large if the declared length is too large, whatever it decodes to.
  api::Check CheckDeclared() const;
  /// Decoded bytes that are certain to come if the declared length does.
  std::uint64_t least_bytes() const { return decoder_ ? 0 : peer_->body_size().value_or(0); }
  /// Fills at most `out` with the next decoded bytes and returns their number; 0 at the end.
  /// Errors: those of HttpPeer::ReadBody() and ContentDecoder::Decode(); malformed_request for a
  /// stream that ends early; mesh_too_large beyond `max_bytes` or the ratio; memory_full.
  api::Outcome<std::size_t> Read(std::span<std::byte> out);

 private:
  api::Outcome<std::size_t> ReadDecoded(std::span<std::byte> out);
  api::Check FillInput();
  api::Check Count(std::size_t made);
  api::Check ChargeMemory();
  api::Problem TooLarge() const;

  HttpPeer* const peer_;
  RequestMemory* const memory_;
  const std::uint64_t max_bytes_;
  std::unique_ptr<ContentDecoder> decoder_;  ///< null without a coding
  std::uint64_t encoded_ = 0, decoded_ = 0;  ///< bytes so far

  std::vector<std::byte>
      input_;  ///< encoded bytes; those from in_begin_ to in_end_ are not decoded
  std::size_t in_begin_ = 0, in_end_ = 0;
  bool is_input_complete_ = false;
  bool has_output_ = false;  ///< the decoder filled the caller's buffer
  RequestMemory::Share share_;
  std::uint64_t charged_ = 0;
};

}  // namespace kdray::server
