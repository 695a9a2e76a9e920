// SPDX-License-Identifier: Apache-2.0
// The framing of a chunked body: chunk sizes, extensions, trailers. It handles bytes in memory;
// connection.h moves the data between them. Source: RFC 9112 (HTTP/1.1), section 7.1.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace kdray::server {

/// Parses strictly what two readers could understand differently: a size is 1 to 16 hexadecimal
/// digits without sign, prefix or blanks, and lines end in CR LF. Extensions and trailers are
/// checked and ignored. Used by one thread.
class ChunkedFraming {
 public:
  static constexpr std::size_t kMaxExtensionBytes = 4 * 1024;  ///< of one chunk, from its ';' on
  static constexpr std::size_t kMaxTrailerBytes = 8 * 1024;    ///< of all trailer lines

  enum class Next : std::uint8_t {
    kFraming,  ///< bytes for Take()
    kData,     ///< data_left() bytes of data
    kEnd,      ///< nothing: the body is complete
    kInvalid,  ///< the body is malformed; see problem()
  };
  /// What comes next on the connection.
  Next next() const { return next_; }

  /// Parses framing bytes from the beginning of `bytes`, and returns their number. The others are
  /// data, or follow the body. Call it while next() is kFraming.
  std::size_t Take(std::string_view bytes);

  std::uint64_t data_left() const { return data_left_; }
  /// `count` bytes of data were taken; at most data_left().
  void TakeData(std::uint64_t count);

  /// For people; after kInvalid.
  std::string_view problem() const { return problem_; }

 private:
  enum class Place : std::uint8_t { kSize, kExtension, kSizeEnd, kDataEnd, kTrailer };

  void TakeByte(char c);
  void TakeSizeByte(char c);
  void TakeTrailerByte(char c);
  void EndSizeLine();
  void Fail(std::string_view problem);

  Next next_ = Next::kFraming;
  Place place_ = Place::kSize;
  int size_digits_ = 0;
  std::uint64_t data_left_ = 0;
  std::size_t extension_bytes_ = 0, trailer_bytes_ = 0;
  bool after_cr_ = false;  ///< in kDataEnd
  std::string line_;       ///< of the trailers
  std::string_view problem_;
};

}  // namespace kdray::server
