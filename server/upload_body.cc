// SPDX-License-Identifier: Apache-2.0
#include "server/upload_body.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;

/// The window is charged in steps of this size.
constexpr std::uint64_t kChargeStepBytes = std::uint64_t{1} << 20;

/// Codings add little to bytes that they cannot compress, and an endless stream of nothing must
/// end.
std::uint64_t MaxEncodedBytes(std::uint64_t max_bytes) {
  return max_bytes + max_bytes / 64 + 64 * 1024;
}

}  // namespace

UploadBody::UploadBody(HttpPeer* peer, RequestMemory* memory, std::optional<ContentCoding> coding,
                       std::uint64_t max_bytes)
    : peer_(peer), memory_(memory), max_bytes_(max_bytes) {
  if (coding) decoder_ = ContentDecoder::Make(*coding);
}

api::Check UploadBody::CheckDeclared() const {
  const std::uint64_t declared = peer_->body_size().value_or(0);
  if (declared <= (decoder_ ? MaxEncodedBytes(max_bytes_) : max_bytes_)) return std::nullopt;
  return Problem{.code = ErrorCode::kMeshTooLarge,
                 .detail = std::string(decoder_ ? "the body" : "the mesh") + " has " +
                           std::to_string(declared) + " bytes, at most " +
                           std::to_string(max_bytes_) + " are taken",
                 .limit = static_cast<double>(max_bytes_),
                 .actual = static_cast<double>(declared)};
}

api::Outcome<std::size_t> UploadBody::Read(std::span<std::byte> out) {
  const auto count = decoder_ ? ReadDecoded(out) : peer_->ReadBody(out);
  if (!count) return count;
  if (auto problem = Count(*count)) return *std::move(problem);
  return count;
}

api::Outcome<std::size_t> UploadBody::ReadDecoded(std::span<std::byte> out) {
  for (;;) {
    if (!has_output_ && !is_input_complete_) {
      if (auto problem = FillInput()) return *std::move(problem);
    }
    const auto in = std::span<const std::byte>(input_).subspan(in_begin_, in_end_ - in_begin_);
    const auto step = decoder_->Decode(in, is_input_complete_, out);
    if (!step) return step.problem();
    in_begin_ += step->taken;
    has_output_ = step->made == out.size();
    if (step->made > 0) return step->made;
    const bool is_stuck = step->taken == 0 && in.size() == input_.size();
    if (!is_input_complete_ && !is_stuck) continue;
    if (encoded_ > 0 && !decoder_->is_complete()) {
      return Problem{.code = ErrorCode::kMalformedRequest,
                     .detail = "the body is not a valid " + std::string(decoder_->name()) +
                               " stream: it ends early, after " + std::to_string(encoded_) +
                               " bytes",
                     .parameter = "Content-Encoding"};
    }
    return std::size_t{0};
  }
}

// Reads until the piece is full, so that the ratio does not depend on how the bytes arrive.
api::Check UploadBody::FillInput() {
  if (input_.empty()) input_.resize(kEncodedPieceBytes);
  std::memmove(input_.data(), input_.data() + in_begin_, in_end_ - in_begin_);
  in_end_ -= std::exchange(in_begin_, 0);
  while (in_end_ < input_.size()) {
    const auto count = peer_->ReadBody(std::span(input_).subspan(in_end_));
    if (!count) return count.problem();
    if (*count == 0) {
      is_input_complete_ = true;
      break;
    }
    in_end_ += *count;
    encoded_ += *count;
    if (encoded_ > MaxEncodedBytes(max_bytes_)) return TooLarge();
    if (auto problem = ChargeMemory()) return problem;
  }
  return std::nullopt;
}

api::Check UploadBody::Count(std::size_t made) {
  decoded_ += made;
  if (decoded_ > max_bytes_) return TooLarge();
  if (!decoder_) return std::nullopt;
  if (decoded_ > encoded_ * kMaxRatio + kRatioSlackBytes) {
    return Problem{.code = ErrorCode::kMeshTooLarge,
                   .detail = std::to_string(encoded_) + " bytes of " +
                             std::string(decoder_->name()) + " decode to more than " +
                             std::to_string(kMaxRatio) + " times their number and 1 MiB",
                   .limit = static_cast<double>(encoded_ * kMaxRatio + kRatioSlackBytes)};
  }
  return ChargeMemory();
}

api::Check UploadBody::ChargeMemory() {
  const std::uint64_t decoded_soon = (decoded_ / kChargeStepBytes + 1) * kChargeStepBytes;
  const std::uint64_t needed = kEncodedPieceBytes + decoder_->MemoryBytes(decoded_soon);
  if (needed <= charged_) return std::nullopt;
  if (charged_ == 0) {
    auto share = memory_->Take(needed, ErrorCode::kMeshTooLarge);
    if (!share) return std::move(share).problem();
    share_ = *std::move(share);
  } else if (auto problem = share_.Grow(needed - charged_, ErrorCode::kMeshTooLarge)) {
    return problem;
  }
  charged_ = needed;
  return std::nullopt;
}

Problem UploadBody::TooLarge() const {
  return Problem{.code = ErrorCode::kMeshTooLarge,
                 .detail = "the mesh has more bytes than the " + std::to_string(max_bytes_) +
                           " that are taken",
                 .limit = static_cast<double>(max_bytes_)};
}

}  // namespace kdray::server
