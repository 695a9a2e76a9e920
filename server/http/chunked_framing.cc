// SPDX-License-Identifier: Apache-2.0
#include "server/http/chunked_framing.h"

#include "server/http/request_head.h"

namespace kdray::server {
namespace {

constexpr int kMaxSizeDigits = 16;  // 64 bits

/// 0 to 15; -1 for another character.
int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

}  // namespace

std::size_t ChunkedFraming::Take(std::string_view bytes) {
  std::size_t taken = 0;
  while (taken < bytes.size() && next_ == Next::kFraming) TakeByte(bytes[taken++]);
  return taken;
}

void ChunkedFraming::TakeData(std::uint64_t count) {
  data_left_ -= count;
  if (data_left_ != 0) return;
  next_ = Next::kFraming;
  place_ = Place::kDataEnd;
  after_cr_ = false;
}

void ChunkedFraming::TakeByte(char c) {
  switch (place_) {
    case Place::kSize:
      return TakeSizeByte(c);
    case Place::kExtension:
      if (c == '\r') {
        place_ = Place::kSizeEnd;
      } else if (!IsFieldValueChar(c)) {
        Fail("a chunk extension has a control character, or its line does not end in CR LF");
      } else if (++extension_bytes_ > kMaxExtensionBytes) {
        Fail("a chunk extension has more than 4096 bytes");
      }
      return;
    case Place::kSizeEnd:
      return c == '\n' ? EndSizeLine() : Fail("the line of a chunk's size must end in CR LF");
    case Place::kDataEnd:
      if (c != (after_cr_ ? '\n' : '\r')) return Fail("a chunk's data must end in CR LF");
      if (after_cr_) place_ = Place::kSize;
      after_cr_ = true;
      return;
    case Place::kTrailer:
      return TakeTrailerByte(c);
  }
}

void ChunkedFraming::TakeSizeByte(char c) {
  if (const int digit = HexDigit(c); digit >= 0) {
    if (++size_digits_ > kMaxSizeDigits) return Fail("a chunk's size has more than 16 digits");
    data_left_ = data_left_ * 16 + static_cast<std::uint64_t>(digit);
  } else if (size_digits_ > 0 && c == '\r') {
    place_ = Place::kSizeEnd;
  } else if (size_digits_ > 0 && c == ';') {
    place_ = Place::kExtension;
    extension_bytes_ = 1;
  } else {
    Fail("a chunk's size must be 1 to 16 hexadecimal digits, then CR LF or ';'");
  }
}

void ChunkedFraming::EndSizeLine() {
  size_digits_ = 0;
  extension_bytes_ = 0;
  if (data_left_ == 0) {
    place_ = Place::kTrailer;
  } else {
    next_ = Next::kData;
  }
}

void ChunkedFraming::TakeTrailerByte(char c) {
  // The line without its CR LF is at most as long as all lines.
  if (c != '\n') {
    if (trailer_bytes_ + line_.size() > kMaxTrailerBytes) {
      return Fail("the trailers have more than 8192 bytes");
    }
    line_ += c;
    return;
  }
  if (!line_.ends_with('\r')) return Fail("the lines of trailers must end in CR LF");
  line_.pop_back();
  if (line_.empty()) {
    next_ = Next::kEnd;
    return;
  }
  if (!IsFieldLine(line_)) return Fail("a trailer is not a header field");
  trailer_bytes_ += line_.size() + 2;
  if (trailer_bytes_ > kMaxTrailerBytes) return Fail("the trailers have more than 8192 bytes");
  line_.clear();
}

void ChunkedFraming::Fail(std::string_view problem) {
  next_ = Next::kInvalid;
  problem_ = problem;
}

}  // namespace kdray::server
