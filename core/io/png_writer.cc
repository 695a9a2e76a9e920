#include "core/io/png_writer.h"

#include <libdeflate.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <memory>
#include <new>
#include <string_view>

#include "core/base/cancel_poll.h"

namespace kdray::core {
namespace {

// libdeflate makes files a quarter smaller than zlib in three quarters of the time (a shaded
// 1280 x 960 picture: 15 ms and 219 kB against 19 ms and 292 kB), but compresses in one call, which
// nothing interrupts. So pictures of up to kBytesAtOnce go through it, which takes some 0.1 s at
// most, and larger ones through zlib, piece by piece. Beyond these levels time grows faster than
// files shrink.
constexpr std::size_t kBytesAtOnce = std::size_t{1} << 23;
constexpr int kLevelAtOnce = 3;
constexpr int kLevelInPieces = 2;
// The input of a piece, and the largest part of the file (chunk IDAT) that is made of it.
constexpr std::size_t kPieceBytes = std::size_t{1} << 18;
// What a byte counts as while it is compressed (CancelPoll).
constexpr std::uint64_t kWorkPerByte = 16;

Error NoMemory() { return {ErrorCode::kMemoryFull, "no memory to compress the picture"}; }

using Bytes = std::vector<std::uint8_t>;

void AppendUint32(std::uint32_t value, Bytes* out) {
  for (int shift = 24; shift >= 0; shift -= 8) {
    out->push_back(static_cast<std::uint8_t>(value >> shift));
  }
}

// A part of a PNG file: length, type, contents, and a checksum of the last two. `type` has four
// letters.
Bytes Chunk(std::string_view type, std::span<const std::uint8_t> contents) {
  Bytes chunk;
  chunk.reserve(contents.size() + 12);
  AppendUint32(static_cast<std::uint32_t>(contents.size()), &chunk);
  chunk.insert(chunk.end(), type.begin(), type.end());
  chunk.insert(chunk.end(), contents.begin(), contents.end());
  AppendUint32(libdeflate_crc32(0, &chunk[4], chunk.size() - 4), &chunk);
  return chunk;
}

Bytes Header(int width, int height, int channels) {
  constexpr std::array<std::uint8_t, 5> kColorTypes = {0, 0, 4, 2, 6};  // by channels
  Bytes header;
  AppendUint32(static_cast<std::uint32_t>(width), &header);
  AppendUint32(static_cast<std::uint32_t>(height), &header);
  // Bits a channel; then compression, filters and interlacing, of which 0 is the usual one.
  header.insert(header.end(), {8, kColorTypes[static_cast<std::size_t>(channels)], 0, 0, 0});
  return Chunk("IHDR", header);
}

// The rows as PNG compresses them: each begins with the number of its filter. All have "sub", which
// takes from each byte the one a pixel before it; to try five on each costs more than the
// compression and made larger files in every picture tried.
class FilteredRows {
 public:
  FilteredRows(std::span<const std::uint8_t> pixels, std::size_t row_bytes, std::size_t channels)
      : pixels_(pixels), row_bytes_(row_bytes), channels_(channels) {}

  std::size_t row_bytes() const { return row_bytes_ + 1; }
  std::size_t count() const { return pixels_.size() / row_bytes_; }
  void Append(std::size_t row, Bytes* out) const {
    constexpr std::uint8_t kSub = 1;
    const std::span<const std::uint8_t> from = pixels_.subspan(row * row_bytes_, row_bytes_);
    const std::size_t begin = out->size();
    out->resize(begin + row_bytes());
    std::uint8_t* const to = out->data() + begin + 1;
    to[-1] = kSub;
    std::copy_n(from.begin(), channels_, to);
    for (std::size_t i = channels_; i < row_bytes_; ++i) {
      to[i] = static_cast<std::uint8_t>(from[i] - from[i - channels_]);
    }
  }

 private:
  std::span<const std::uint8_t> pixels_;
  std::size_t row_bytes_, channels_;
};

using Chunks = std::vector<Bytes>;

Status CompressAtOnce(const FilteredRows& rows, Chunks* chunks) {
  Bytes filtered;
  filtered.reserve(rows.count() * rows.row_bytes());
  for (std::size_t row = 0; row < rows.count(); ++row) rows.Append(row, &filtered);
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(kLevelAtOnce), &libdeflate_free_compressor);
  if (!compressor) return NoMemory();
  Bytes out(libdeflate_zlib_compress_bound(compressor.get(), filtered.size()));
  const std::size_t size = libdeflate_zlib_compress(compressor.get(), filtered.data(),
                                                    filtered.size(), out.data(), out.size());
  chunks->push_back(Chunk("IDAT", std::span(out).first(size)));
  return {};
}

Status CompressInPieces(const FilteredRows& rows, CancelPoll* poll, Chunks* chunks) {
  z_stream stream = {};
  if (deflateInit(&stream, kLevelInPieces) != Z_OK) return NoMemory();
  const std::unique_ptr<z_stream, decltype(&deflateEnd)> end(&stream, &deflateEnd);
  const std::size_t rows_at_once = std::max<std::size_t>(1, kPieceBytes / rows.row_bytes());
  Bytes filtered;
  Bytes out(kPieceBytes);
  for (std::size_t row = 0; row < rows.count();) {
    const std::size_t last = std::min(rows.count(), row + rows_at_once);
    filtered.clear();
    for (; row < last; ++row) rows.Append(row, &filtered);
    stream.next_in = filtered.data();
    stream.avail_in = static_cast<uInt>(filtered.size());
    const bool is_end = row == rows.count();
    // As long as it fills the output, there may be more.
    do {
      if (poll->Spend(kPieceBytes * kWorkPerByte)) return poll->ToError();
      stream.next_out = out.data();
      stream.avail_out = static_cast<uInt>(out.size());
      deflate(&stream, is_end ? Z_FINISH : Z_NO_FLUSH);
      const std::size_t size = out.size() - stream.avail_out;
      if (size != 0) chunks->push_back(Chunk("IDAT", std::span(out).first(size)));
    } while (stream.avail_out == 0);
  }
  return {};
}

Result<std::vector<std::byte>> Encode(std::span<const std::uint8_t> pixels, int width, int height,
                                      int channels, const CancelToken& cancel) {
  CancelPoll poll(cancel);
  if (poll.Spend(1)) return poll.ToError();
  Chunks chunks;
  chunks.push_back({0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'});
  chunks.push_back(Header(width, height, channels));
  const FilteredRows rows(pixels, pixels.size() / static_cast<std::size_t>(height),
                          static_cast<std::size_t>(channels));
  const Status status = pixels.size() <= kBytesAtOnce ? CompressAtOnce(rows, &chunks)
                                                      : CompressInPieces(rows, &poll, &chunks);
  if (!status.ok()) return status.error();
  chunks.push_back(Chunk("IEND", {}));

  std::size_t size = 0;
  for (const Bytes& chunk : chunks) size += chunk.size();
  std::vector<std::byte> file;
  file.reserve(size);
  for (Bytes& chunk : chunks) {
    if (poll.Spend(chunk.size())) return poll.ToError();
    const auto bytes = std::as_bytes(std::span(chunk));
    file.insert(file.end(), bytes.begin(), bytes.end());
    chunk = Bytes();
  }
  return file;
}

}  // namespace

Result<std::vector<std::byte>> EncodePng(std::span<const std::uint8_t> pixels, int width,
                                         int height, int channels, const CancelToken& cancel) {
  if (width < 1 || width > kMaxPngSide || height < 1 || height > kMaxPngSide || channels < 1 ||
      channels > 4) {
    return Error{ErrorCode::kInvalidArgument, "a PNG has sides of 1 to 16384 pixels"};
  }
  const std::size_t bytes = static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                            static_cast<std::size_t>(channels);
  if (bytes >= std::size_t{1} << 30) {
    return Error{ErrorCode::kInvalidArgument, "a PNG has less than 2^30 bytes of pixels"};
  }
  if (pixels.size() != bytes) {
    return Error{ErrorCode::kInvalidArgument, "the pixels do not fill the sides"};
  }
  try {
    return Encode(pixels, width, height, channels, cancel);
  } catch (const std::bad_alloc&) {
    return NoMemory();
  }
}

}  // namespace kdray::core
