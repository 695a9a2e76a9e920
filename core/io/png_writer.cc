// SPDX-License-Identifier: Apache-2.0
#include "core/io/png_writer.h"

#include <libdeflate.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>
#include <memory>
#include <new>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/cancel_poll.h"
#include "core/base/parallel.h"

namespace kdray::core {
namespace {

// A picture is cut into strips of rows, which are compressed in parallel, and whose streams are
// joined. Their number depends on the picture alone, so the file does not depend on the number of
// threads. A strip of this size takes some 16 ms, so the work ends soon after a cancellation.
// Smaller strips make larger files, and each one except the last is decoded to join it (Open).
constexpr std::size_t kMostStripBytes = std::size_t{1} << 22;
// Of libdeflate. Level 1 is no faster on rendered pictures; at higher levels, time grows faster
// than files shrink.
constexpr int kLevel = 2;
// Work (CancelPoll) of filtering and compressing a byte.
constexpr std::uint64_t kWorkPerByte = 16;

// One strip's part of the picture's stream.
struct StripStream {
  std::size_t lead_bytes = 0;  // filtered bytes of the row before the strip, which is not its own
  bool is_last = false;
  uLong checksum = 0;     // Adler-32 of the filtered bytes
  std::size_t bytes = 0;  // their number
};

// The PNG library's hook takes no context. Set while a thread is inside the library.
thread_local StripStream* current_strip = nullptr;

// Memory from malloc(), which the PNG library frees.
struct FreeBytes {
  void operator()(unsigned char* bytes) const { std::free(bytes); }
};
using MallocBytes = std::unique_ptr<unsigned char, FreeBytes>;

// Makes a stream of libdeflate one that another can follow: clears the mark of the last block and
// adds an empty stored block, which ends at a byte (RFC 1951, 3.2.3 and 3.2.4). libdeflate reports
// neither where blocks begin nor the last one's end, so zlib's decoder finds them; it stops at each
// block (zlib.h, Z_BLOCK, which is meant for this). `out` has room for kMostAdded bytes after
// `*size`. False if the stream is not valid or memory runs out.
constexpr std::size_t kMostAdded = 5;
bool Open(std::size_t decoded_bytes, unsigned char* out, std::size_t* size) {
  z_stream stream = {};
  constexpr int kRawWindowBits = -15;
  if (inflateInit2(&stream, kRawWindowBits) != Z_OK) return false;
  const std::unique_ptr<z_stream, decltype(&inflateEnd)> end(&stream, &inflateEnd);
  std::vector<unsigned char> decoded(decoded_bytes + 1);  // never full, so it never ends early
  stream.next_in = out;
  stream.avail_in = static_cast<uInt>(*size);
  stream.next_out = decoded.data();
  stream.avail_out = static_cast<uInt>(decoded.size());
  constexpr int kUnusedBits = 7;
  constexpr int kIsLastBlock = 64;
  constexpr int kIsBetweenBlocks = 128;
  std::size_t last_block = 0;  // first bit
  for (;;) {
    if (inflate(&stream, Z_BLOCK) != Z_OK) return false;
    if ((stream.data_type & kIsBetweenBlocks) == 0) continue;
    const std::size_t bit =
        std::size_t{8} * stream.total_in - static_cast<std::size_t>(stream.data_type & kUnusedBits);
    if ((stream.data_type & kIsLastBlock) == 0) {
      last_block = bit;
      continue;
    }
    out[last_block / 8] &= static_cast<unsigned char>(~(1u << last_block % 8));
    // The header of a stored block is three zero bits and zeros up to a byte; then come its length,
    // 0, and the length's complement.
    *size = (bit + 3 + 7) / 8;
    if (bit % 8 != 0) out[bit / 8] &= static_cast<unsigned char>((1u << bit % 8) - 1);
    for (std::size_t i = (bit + 7) / 8; i < *size; ++i) out[i] = 0;
    for (const unsigned char byte : {0x00, 0x00, 0xff, 0xff}) out[(*size)++] = byte;
    return true;
  }
}

// A piece of a deflate stream, without the header and the checksum of zlib's format. Null if memory
// runs out.
MallocBytes CompressStrip(std::span<const unsigned char> data, StripStream* strip,
                          std::size_t* size) {
  strip->checksum = libdeflate_adler32(1, data.data(), data.size());
  strip->bytes = data.size();
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(kLevel), &libdeflate_free_compressor);
  if (!compressor) return nullptr;
  const std::size_t bound = libdeflate_deflate_compress_bound(compressor.get(), data.size());
  MallocBytes out(static_cast<unsigned char*>(std::malloc(bound + kMostAdded)));
  if (out == nullptr) return nullptr;
  *size = libdeflate_deflate_compress(compressor.get(), data.data(), data.size(), out.get(), bound);
  if (!strip->is_last && !Open(data.size(), out.get(), size)) return nullptr;
  return out;
}

// Called by the PNG library, which takes null as a failure.
unsigned char* Compress(unsigned char* data, int size, int* compressed_size, int /*quality*/) {
  const auto rows = std::span<const unsigned char>(data, static_cast<std::size_t>(size))
                        .subspan(current_strip->lead_bytes);
  std::size_t compressed_bytes = 0;
  try {
    MallocBytes compressed = CompressStrip(rows, current_strip, &compressed_bytes);
    *compressed_size = static_cast<int>(compressed_bytes);
    return compressed.release();
  } catch (const std::bad_alloc&) {
    return nullptr;  // an exception would pass through the library's C code
  }
}

unsigned int Crc32(unsigned char* data, int size) {
  return libdeflate_crc32(0, data, static_cast<std::size_t>(size));
}

}  // namespace
}  // namespace kdray::core

#define STBIW_ZLIB_COMPRESS kdray::core::Compress
#define STBIW_CRC32 kdray::core::Crc32
#define STBI_WRITE_NO_STDIO
#define STB_IMAGE_WRITE_STATIC
#define STB_IMAGE_WRITE_IMPLEMENTATION
#include <stb/stb_image_write.h>

namespace kdray::core {
namespace {

// The library's settings are global, so they are made once, before main(). One filter for all rows
// ("up"): trying five on each costs more than the compression, and "sub" makes files 4 to 8 percent
// larger.
[[maybe_unused]] const bool settings_made = [] {
  stbi_write_force_png_filter = 2;
  return true;
}();

constexpr std::string_view kNoMemory = "no memory to compress the picture";

// Layout of a PNG file of the library: the signature, the chunk IHDR, one chunk IDAT, the chunk
// IEND. A chunk has its length, its type, its bytes and their CRC.
constexpr std::size_t kSignatureBytes = 8;
constexpr std::size_t kChunkBytes = 12;  // besides its content
constexpr std::size_t kHeaderBytes = 13;
constexpr std::size_t kBeforeData = kSignatureBytes + kChunkBytes + kHeaderBytes;
constexpr std::size_t kEndBytes = kChunkBytes;

void AppendNumber(std::uint32_t number, std::vector<std::byte>* out) {
  for (int shift = 24; shift >= 0; shift -= 8) {
    out->push_back(static_cast<std::byte>(number >> shift & 0xff));
  }
}

void AppendChunk(std::string_view type, std::span<const std::byte> content,
                 std::vector<std::byte>* out) {
  AppendNumber(static_cast<std::uint32_t>(content.size()), out);
  const std::size_t begin = out->size();
  for (const char c : type) out->push_back(static_cast<std::byte>(c));
  out->insert(out->end(), content.begin(), content.end());
  AppendNumber(libdeflate_crc32(0, out->data() + begin, out->size() - begin), out);
}

struct PixelRows {
  const std::uint8_t* first = nullptr;
  int width = 0, height = 0, channels = 0;

  std::size_t RowBytes() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(channels);
  }
};

// The PNG file of the library; empty if memory runs out.
std::span<const std::byte> WritePng(const PixelRows& rows, MallocBytes* png) {
  int size = 0;
  png->reset(stbi_write_png_to_mem(rows.first, 0, rows.width, rows.height, rows.channels, &size));
  if (*png == nullptr) return {};
  return {reinterpret_cast<const std::byte*>(png->get()), static_cast<std::size_t>(size)};
}

struct Strip {
  StripStream stream;
  MallocBytes png;
  std::span<const std::byte> data_chunk;
};

// The library writes each strip as a file of its own, whose IDAT chunk becomes one of the
// picture's. The filter subtracts the row above, so a strip is written with the row before it,
// whose filtered bytes the hook leaves out.
Result<std::vector<std::byte>> EncodeInStrips(const PixelRows& picture, const CancelToken& cancel) {
  const std::size_t row_bytes = picture.RowBytes();
  const auto height = static_cast<std::size_t>(picture.height);
  const std::size_t strip_count = (height * row_bytes + kMostStripBytes - 1) / kMostStripBytes;
  const std::size_t rows_at_once = (height + strip_count - 1) / strip_count;
  std::vector<Strip> strips((height + rows_at_once - 1) / rows_at_once);
  std::atomic<bool> stopped{false};
  std::atomic<bool> failed{false};
  ParallelFor(0, strips.size(), 1, [&](std::size_t i, std::size_t) {
    const std::size_t row = i * rows_at_once;
    const std::size_t count = std::min(rows_at_once, height - row);
    CancelPoll poll(cancel);
    if (stopped || failed || poll.Spend(count * row_bytes * kWorkPerByte)) {
      stopped = stopped || poll.stopped();
      return;
    }
    const std::size_t lead = i == 0 ? 0 : 1;
    Strip& strip = strips[i];
    strip.stream = {.lead_bytes = lead * (row_bytes + 1), .is_last = i + 1 == strips.size()};
    PixelRows rows = picture;
    rows.first += (row - lead) * row_bytes;
    rows.height = static_cast<int>(count + lead);
    current_strip = &strip.stream;
    const std::span<const std::byte> png = WritePng(rows, &strip.png);
    current_strip = nullptr;
    if (png.empty()) {
      failed = true;
    } else {
      strip.data_chunk = png.subspan(kBeforeData, png.size() - kBeforeData - kEndBytes);
    }
  });
  if (stopped) return cancel.ToError();
  if (failed) return Error{ErrorCode::kMemoryFull, std::string(kNoMemory)};

  const std::span<const std::byte> first(reinterpret_cast<const std::byte*>(strips[0].png.get()),
                                         kBeforeData);
  std::size_t size = kBeforeData + kEndBytes + 3 * kChunkBytes;
  for (const Strip& strip : strips) size += strip.data_chunk.size();
  std::vector<std::byte> file;
  file.reserve(size);
  file.insert(file.end(), first.begin(), first.begin() + kSignatureBytes);
  // The header of the first strip, with the height of the picture.
  std::vector<std::byte> header(first.begin() + kSignatureBytes + 8, first.end() - 4);
  std::vector<std::byte> side;
  AppendNumber(static_cast<std::uint32_t>(picture.height), &side);
  std::copy(side.begin(), side.end(), header.begin() + 4);
  AppendChunk("IHDR", header, &file);
  // The header of zlib's format: a window of 32 KiB, the fastest level.
  AppendChunk("IDAT", std::array{std::byte{0x78}, std::byte{0x01}}, &file);
  uLong checksum = strips[0].stream.checksum;
  for (std::size_t i = 0; i < strips.size(); ++i) {
    const Strip& strip = strips[i];
    file.insert(file.end(), strip.data_chunk.begin(), strip.data_chunk.end());
    if (i == 0) continue;
    checksum =
        adler32_combine(checksum, strip.stream.checksum, static_cast<z_off_t>(strip.stream.bytes));
  }
  std::vector<std::byte> trailer;
  AppendNumber(static_cast<std::uint32_t>(checksum), &trailer);
  AppendChunk("IDAT", trailer, &file);
  AppendChunk("IEND", {}, &file);
  return file;
}

}  // namespace

Result<std::vector<std::byte>> EncodePng(std::span<const std::uint8_t> pixels, int width,
                                         int height, int channels, const CancelToken& cancel) {
  if (width < 1 || width > kMaxPngSide || height < 1 || height > kMaxPngSide || channels < 1 ||
      channels > 4) {
    return Error{ErrorCode::kInvalidArgument, "a PNG has sides of 1 to 16384 pixels"};
  }
  const PixelRows picture = {pixels.data(), width, height, channels};
  const std::size_t bytes = picture.RowBytes() * static_cast<std::size_t>(height);
  // The library multiplies sides in int and adds a margin for compression.
  if (bytes >= std::size_t{1} << 30) {
    return Error{ErrorCode::kInvalidArgument, "a PNG has less than 2^30 bytes of pixels"};
  }
  if (pixels.size() != bytes) {
    return Error{ErrorCode::kInvalidArgument, "the number of pixels does not match the sides"};
  }
  try {
    return EncodeInStrips(picture, cancel);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemoryFull, std::string(kNoMemory)};
  }
}

}  // namespace kdray::core
