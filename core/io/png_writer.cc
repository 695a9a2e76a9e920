#include "core/io/png_writer.h"

#include <libdeflate.h>
#include <zlib.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <utility>

#include "core/base/cancel_poll.h"

namespace kdray::core {
namespace {

// libdeflate makes files a quarter smaller than zlib in three quarters of the time (a shaded 1280 x
// 960 picture: 15 ms and 219 kB against 19 ms and 292 kB), but compresses in one call, which cannot
// be cancelled. So it compresses pictures of up to kBytesAtOnce, in some 0.1 s at most; zlib
// compresses larger ones piece by piece. At higher levels, time grows faster than files shrink.
constexpr std::size_t kBytesAtOnce = std::size_t{1} << 23;
constexpr int kLevelAtOnce = 3;
constexpr int kLevelInPieces = 2;
constexpr std::size_t kPieceBytes = std::size_t{1} << 18;  // of zlib's input, and of its output
// Work (CancelPoll) of compressing a byte.
constexpr std::uint64_t kWorkPerByte = 16;

// The PNG library's hook takes no context. Set while a thread is inside the library.
thread_local CancelPoll* current_poll = nullptr;

// Memory from malloc(), which the PNG library frees.
struct FreeBytes {
  void operator()(unsigned char* bytes) const { std::free(bytes); }
};
using MallocBytes = std::unique_ptr<unsigned char, FreeBytes>;

MallocBytes CompressAtOnce(std::span<const unsigned char> data, std::size_t* size) {
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(kLevelAtOnce), &libdeflate_free_compressor);
  if (!compressor) return nullptr;
  const std::size_t bound = libdeflate_zlib_compress_bound(compressor.get(), data.size());
  MallocBytes out(static_cast<unsigned char*>(std::malloc(bound)));
  if (out == nullptr) return nullptr;
  *size = libdeflate_zlib_compress(compressor.get(), data.data(), data.size(), out.get(), bound);
  return out;
}

// At least `bytes`, doubled as it grows; null if memory runs out.
MallocBytes Grown(MallocBytes old, std::size_t bytes, std::size_t* capacity) {
  if (bytes <= *capacity) return old;
  const std::size_t larger = std::max(bytes, 2 * *capacity);
  auto* const moved = static_cast<unsigned char*>(std::realloc(old.get(), larger));
  if (moved == nullptr) return nullptr;
  [[maybe_unused]] const unsigned char* const given_up = old.release();
  *capacity = larger;
  return MallocBytes(moved);
}

// Null if memory runs out or `poll` has stopped.
MallocBytes CompressInPieces(std::span<const unsigned char> data, CancelPoll* poll,
                             std::size_t* size) {
  z_stream stream = {};
  if (deflateInit(&stream, kLevelInPieces) != Z_OK) return nullptr;
  const std::unique_ptr<z_stream, decltype(&deflateEnd)> end(&stream, &deflateEnd);
  MallocBytes out;
  std::size_t capacity = 0;
  *size = 0;
  for (std::size_t begin = 0; begin < data.size(); begin += kPieceBytes) {
    const auto piece = data.subspan(begin, std::min(kPieceBytes, data.size() - begin));
    const bool is_last = begin + piece.size() == data.size();
    stream.next_in = const_cast<Bytef*>(piece.data());  // zlib only reads it
    stream.avail_in = static_cast<uInt>(piece.size());
    // While zlib fills the output, there may be more.
    do {
      if (poll->Spend(kPieceBytes * kWorkPerByte)) return nullptr;
      out = Grown(std::move(out), *size + kPieceBytes, &capacity);
      if (out == nullptr) return nullptr;
      stream.next_out = out.get() + *size;
      stream.avail_out = static_cast<uInt>(kPieceBytes);
      deflate(&stream, is_last ? Z_FINISH : Z_NO_FLUSH);
      *size += kPieceBytes - stream.avail_out;
    } while (stream.avail_out == 0);
  }
  return out;
}

// Called by the PNG library, which takes null as a failure.
unsigned char* Compress(unsigned char* data, int size, int* compressed_size, int /*quality*/) {
  const std::span<const unsigned char> bytes(data, static_cast<std::size_t>(size));
  std::size_t compressed_bytes = 0;
  MallocBytes compressed = bytes.size() <= kBytesAtOnce
                               ? CompressAtOnce(bytes, &compressed_bytes)
                               : CompressInPieces(bytes, current_poll, &compressed_bytes);
  *compressed_size = static_cast<int>(compressed_bytes);
  return compressed.release();
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
// ("sub"): trying five on each costs more than the compression and made larger files in every
// picture tried.
[[maybe_unused]] const bool settings_made = [] {
  stbi_write_force_png_filter = 1;
  return true;
}();

}  // namespace

// The library filters all rows in one call before it compresses them. That call cannot be
// cancelled: some 0.7 ns a byte, so 0.2 s for the largest picture that a server allows by default.
Result<std::vector<std::byte>> EncodePng(std::span<const std::uint8_t> pixels, int width,
                                         int height, int channels, const CancelToken& cancel) {
  if (width < 1 || width > kMaxPngSide || height < 1 || height > kMaxPngSide || channels < 1 ||
      channels > 4) {
    return Error{ErrorCode::kInvalidArgument, "a PNG has sides of 1 to 16384 pixels"};
  }
  const std::size_t bytes = static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                            static_cast<std::size_t>(channels);
  // The library multiplies sides in int and adds a margin for compression.
  if (bytes >= std::size_t{1} << 30) {
    return Error{ErrorCode::kInvalidArgument, "a PNG has less than 2^30 bytes of pixels"};
  }
  if (pixels.size() != bytes) {
    return Error{ErrorCode::kInvalidArgument, "the number of pixels does not match the sides"};
  }
  CancelPoll poll(cancel);
  if (poll.Spend(1)) return poll.ToError();
  int size = 0;
  current_poll = &poll;
  const MallocBytes png(stbi_write_png_to_mem(pixels.data(), 0, width, height, channels, &size));
  current_poll = nullptr;
  if (poll.stopped()) return poll.ToError();
  const Error no_memory{ErrorCode::kMemoryFull, "no memory to compress the picture"};
  if (!png) return no_memory;
  try {
    std::vector<std::byte> result(static_cast<std::size_t>(size));
    std::memcpy(result.data(), png.get(), result.size());
    return result;
  } catch (const std::bad_alloc&) {
    return no_memory;
  }
}

}  // namespace kdray::core
