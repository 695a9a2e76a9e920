// SPDX-License-Identifier: Apache-2.0
#include "server/content_decoder.h"

#include <zlib.h>
#include <zstd.h>
#include <zstd_errors.h>

#include <algorithm>
#include <climits>
#include <cstring>
#include <new>
#include <string>

#include "server/http/message.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;

Problem Damaged(std::string_view coding, const std::string& why) {
  return {.code = ErrorCode::kMalformedRequest,
          .detail = "the body is not a valid " + std::string(coding) + " stream: " + why,
          .parameter = "Content-Encoding"};
}

class GzipDecoder final : public ContentDecoder {
 public:
  GzipDecoder() {
    constexpr int kGzipOnly = 16;
    if (inflateInit2(&stream_, MAX_WBITS + kGzipOnly) != Z_OK) throw std::bad_alloc();
  }
  ~GzipDecoder() override { inflateEnd(&stream_); }
  GzipDecoder(const GzipDecoder&) = delete;
  GzipDecoder& operator=(const GzipDecoder&) = delete;

  api::Outcome<Step> Decode(std::span<const std::byte> in, bool /*is_last*/,
                            std::span<std::byte> out) override {
    Step step;
    while (step.made < out.size() && (step.taken < in.size() || has_output_)) {
      if (is_complete_ && !StartMember(in[step.taken])) {
        return Damaged(name(), "bytes that are not a gzip member follow its end");
      }
      stream_.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(in.data() + step.taken));
      stream_.avail_in = Clamp(in.size() - step.taken);
      stream_.next_out = reinterpret_cast<Bytef*>(out.data() + step.made);
      stream_.avail_out = Clamp(out.size() - step.made);
      const uInt in_before = stream_.avail_in, out_before = stream_.avail_out;
      const int result = inflate(&stream_, Z_NO_FLUSH);
      step.taken += in_before - stream_.avail_in;
      step.made += out_before - stream_.avail_out;
      is_complete_ = result == Z_STREAM_END;
      has_output_ = result == Z_OK && stream_.avail_out == 0;
      if (result == Z_MEM_ERROR) throw std::bad_alloc();
      if (result != Z_OK && result != Z_STREAM_END && result != Z_BUF_ERROR) {
        return Damaged(name(), stream_.msg != nullptr ? stream_.msg : "it is damaged");
      }
    }
    return step;
  }
  bool is_complete() const override { return is_complete_; }
  std::string_view name() const override { return "gzip"; }
  std::uint64_t MemoryBytes(std::uint64_t /*decoded*/) const override { return 48 * 1024; }

 private:
  static uInt Clamp(std::size_t size) {
    return static_cast<uInt>(std::min<std::size_t>(size, UINT_MAX));
  }

  /// After a whole member. False if `first` does not begin another one.
  bool StartMember(std::byte first) {
    if (first != std::byte{0x1f}) return false;
    inflateReset(&stream_);
    is_complete_ = false;
    return true;
  }

  z_stream stream_{};
  bool is_complete_ = false;
  bool has_output_ = false;  ///< there may be decoded bytes for which there was no room
};

class ZstdDecoder final : public ContentDecoder {
 public:
  ZstdDecoder() : context_(ZSTD_createDCtx()) {
    if (context_ == nullptr) throw std::bad_alloc();
    constexpr int kMaxWindowLog = 23;
    static_assert(std::uint64_t{1} << kMaxWindowLog == kMaxWindowBytes);
    ZSTD_DCtx_setParameter(context_.get(), ZSTD_d_windowLogMax, kMaxWindowLog);
  }

  api::Outcome<Step> Decode(std::span<const std::byte> in, bool is_last,
                            std::span<std::byte> out) override {
    ZSTD_inBuffer input{in.data(), in.size(), 0};
    ZSTD_outBuffer output{out.data(), out.size(), 0};
    while (output.pos < output.size && (input.pos < input.size || has_output_)) {
      if (at_frame_start_ && !has_output_) {
        const auto rest = in.subspan(input.pos);
        if (rest.size() < kLeastInputBytes && !is_last) break;
        if (!BeginsFrame(rest)) {
          return Damaged(name(), "bytes that are not a zstd frame stand in the place of one");
        }
      }
      const std::size_t in_before = input.pos, out_before = output.pos;
      const std::size_t result = ZSTD_decompressStream(context_.get(), &output, &input);
      if (ZSTD_isError(result)) return ToProblem(result);
      at_frame_start_ = result == 0;
      // The library may hold decoded bytes for which there was no room.
      has_output_ = result != 0 && output.pos == output.size;
      if (input.pos == in_before && output.pos == out_before) break;
    }
    return Step{input.pos, output.pos};
  }
  bool is_complete() const override { return at_frame_start_; }
  std::string_view name() const override { return "zstd"; }
  std::uint64_t MemoryBytes(std::uint64_t decoded) const override {
    // Buffers of the library, for a block of input and the window with one more block.
    constexpr std::uint64_t kFixed = 512 * 1024;
    return kFixed + std::min(decoded, kMaxWindowBytes);
  }

 private:
  struct Free {
    void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
  };

  /// Not the formats before 0.8, which the library would read too, without a limit of the window.
  static bool BeginsFrame(std::span<const std::byte> bytes) {
    if (bytes.size() < 4) return false;
    std::uint32_t magic = 0;
    for (int i = 3; i >= 0; --i) {
      magic = magic << 8 | std::to_integer<std::uint32_t>(bytes[static_cast<std::size_t>(i)]);
    }
    return magic == ZSTD_MAGICNUMBER ||
           (magic & ZSTD_MAGIC_SKIPPABLE_MASK) == ZSTD_MAGIC_SKIPPABLE_START;
  }

  Problem ToProblem(std::size_t result) const {
    switch (ZSTD_getErrorCode(result)) {
      case ZSTD_error_memory_allocation:
        throw std::bad_alloc();
      case ZSTD_error_frameParameter_windowTooLarge:
        return {.code = ErrorCode::kUnsupportedEncoding,
                .detail =
                    "a zstd frame needs a window of more than 8 MiB; compress it without "
                    "--long and --ultra",
                .parameter = "Content-Encoding",
                .limit = static_cast<double>(kMaxWindowBytes)};
      case ZSTD_error_dictionary_wrong:
        return {.code = ErrorCode::kUnsupportedEncoding,
                .detail = "a zstd frame needs a dictionary; compress it without one",
                .parameter = "Content-Encoding"};
      default:
        return Damaged(name(), ZSTD_getErrorName(result));
    }
  }

  std::unique_ptr<ZSTD_DCtx, Free> context_;
  bool at_frame_start_ = true, has_output_ = false;
};

}  // namespace

std::optional<ContentCoding> ParseContentCoding(std::string_view name) {
  if (EqualsIgnoringCase(name, "gzip") || EqualsIgnoringCase(name, "x-gzip")) {
    return ContentCoding::kGzip;
  }
  if (EqualsIgnoringCase(name, "zstd")) return ContentCoding::kZstd;
  return std::nullopt;
}

std::unique_ptr<ContentDecoder> ContentDecoder::Make(ContentCoding coding) {
  if (coding == ContentCoding::kGzip) return std::make_unique<GzipDecoder>();
  return std::make_unique<ZstdDecoder>();
}

}  // namespace kdray::server
