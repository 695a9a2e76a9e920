// SPDX-License-Identifier: Apache-2.0
#include "api/npy.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <optional>
#include <utility>

#include "api/quoted.h"

namespace kdray::api {
namespace {

constexpr std::size_t kMaxRank = 33;  // a batch's leading shape has at most numpy's 32 dimensions
constexpr std::string_view kAllowed = "send little-endian floats, '<f4' or '<f8'";

Problem InvalidArray(std::string detail) {
  return Problem{ErrorCode::kInvalidArray, std::move(detail)};
}

std::size_t ElementSize(NumberType type) { return type == NumberType::kF4 ? 4 : 8; }

/// Parses the header's dictionary. Accepts only the literals of the three keys; no program writes
/// other Python literals here.
class HeaderParser {
 public:
  explicit HeaderParser(std::string_view text) : text_(text) {}

  Outcome<NpyArray> Parse() {
    if (!Take('{')) return Damaged("a '{'");
    while (!Take('}')) {
      const std::optional<std::string_view> key = String();
      if (!key) return Damaged("a key in quotes or '}'");
      if (!Take(':')) return Damaged("a ':'");
      Check refused = *key == "descr"           ? Once(&seen_descr_, *key, &HeaderParser::Descr)
                      : *key == "fortran_order" ? Once(&seen_order_, *key, &HeaderParser::Order)
                      : *key == "shape"
                          ? Once(&seen_shape_, *key, &HeaderParser::Shape)
                          : InvalidArray("the .npy header has the unknown key " + Quoted(*key));
      if (refused) return *std::move(refused);
      if (Take(',')) continue;
      if (!Take('}')) return Damaged("a ',' or '}'");
      break;
    }
    SkipSpace();
    if (at_ != text_.size()) return Damaged("the end of the header");
    for (const auto& [seen, key] :
         {std::pair{seen_descr_, "descr"}, std::pair{seen_order_, "fortran_order"},
          std::pair{seen_shape_, "shape"}}) {
      if (!seen) return InvalidArray(std::string("the .npy header has no '") + key + "'");
    }
    return std::move(array_);
  }

 private:
  Problem Damaged(std::string_view wanted) const {
    return InvalidArray("the .npy header is damaged: " + std::string(wanted) +
                        " was expected at its byte " + std::to_string(at_));
  }

  Check Once(bool* seen, std::string_view key, Check (HeaderParser::*value)()) {
    if (std::exchange(*seen, true)) {
      return InvalidArray("the .npy header has the key " + Quoted(key) + " twice");
    }
    return (this->*value)();
  }

  Check Descr() {
    SkipSpace();
    if (at_ < text_.size() && (text_[at_] == '[' || text_[at_] == '(')) {
      return InvalidArray("the array has a structured type; " + std::string(kAllowed));
    }
    const std::optional<std::string_view> descr = String();
    if (!descr) return Damaged("the type in quotes");
    if (*descr != "<f4" && *descr != "<f8") {
      return InvalidArray("the array has the type " + Quoted(*descr) + "; " +
                          std::string(kAllowed));
    }
    array_.type = *descr == "<f4" ? NumberType::kF4 : NumberType::kF8;
    return std::nullopt;
  }

  Check Order() {
    if (Word("True")) {
      array_.fortran_order = true;
    } else if (!Word("False")) {
      return Damaged("True or False");
    }
    return std::nullopt;
  }

  Check Shape() {
    if (!Take('(')) return Damaged("the shape's '('");
    bool comma = true;  // (6) is a number in parentheses; a tuple of one is (6,)
    while (!Take(')')) {
      if (!comma) return Damaged("a ',' or ')'");
      const std::optional<std::size_t> length = Length();
      if (!length) return Damaged("a length from 0 to 2^64-1");
      if (array_.shape.size() == kMaxRank) {
        return InvalidArray("the array has more than " + std::to_string(kMaxRank) + " dimensions");
      }
      array_.shape.push_back(*length);
      comma = Take(',');
    }
    if (array_.shape.size() == 1 && !comma) return Damaged("a ',' in the shape of one dimension");
    return std::nullopt;
  }

  void SkipSpace() {
    while (at_ < text_.size() &&
           (text_[at_] == ' ' || text_[at_] == '\n' || text_[at_] == '\t' || text_[at_] == '\r')) {
      ++at_;
    }
  }

  bool Take(char c) {
    SkipSpace();
    if (at_ == text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }

  bool Word(std::string_view word) {
    SkipSpace();
    if (!text_.substr(at_).starts_with(word)) return false;
    at_ += word.size();
    return true;
  }

  /// A string without escapes, which the accepted keys and types do not need.
  std::optional<std::string_view> String() {
    SkipSpace();
    if (at_ == text_.size() || (text_[at_] != '\'' && text_[at_] != '"')) return std::nullopt;
    const std::size_t end = text_.find(text_[at_], at_ + 1);
    if (end == std::string_view::npos) return std::nullopt;
    const std::string_view inside = text_.substr(at_ + 1, end - at_ - 1);
    if (inside.find('\\') != std::string_view::npos) return std::nullopt;
    at_ = end + 1;
    return inside;
  }

  std::optional<std::size_t> Length() {
    SkipSpace();
    std::size_t length = 0;
    const char* begin = text_.data() + at_;
    const auto [end, error] = std::from_chars(begin, text_.data() + text_.size(), length);
    if (error != std::errc()) return std::nullopt;
    at_ += static_cast<std::size_t>(end - begin);
    if (at_ < text_.size() && text_[at_] == 'L') ++at_;  // written by Python 2
    return length;
  }

  std::string_view text_;
  std::size_t at_ = 0;
  NpyArray array_;
  bool seen_descr_ = false, seen_order_ = false, seen_shape_ = false;
};

/// Bytes of all elements. A length of 0 does not hide an overflow of the others, because readers of
/// the answer, which has the same leading shape, would overflow.
std::optional<std::uint64_t> TotalBytes(const NpyArray& array) {
  std::uint64_t bytes = ElementSize(array.type);
  bool empty = false;
  for (const std::uint64_t length : array.shape) {
    if (length == 0) {
      empty = true;
    } else if (bytes > std::numeric_limits<std::int64_t>::max() / length) {
      return std::nullopt;
    } else {
      bytes *= length;
    }
  }
  return empty ? 0 : bytes;
}

/// Says what the body is instead, if it can be recognised.
std::string WhyNotNpy(std::string_view bytes) {
  if (bytes.starts_with("PK\x03\x04")) {
    return "the body is a ZIP archive, perhaps an .npz file; send one array as an .npy file "
           "(numpy.save, not numpy.savez)";
  }
  if (bytes.starts_with("\x1f\x8b")) return "the body is gzip data; send the .npy file itself";
  return "the body does not begin as a .npy file does (\\x93NUMPY)";
}

}  // namespace

Outcome<NpyStart> ReadNpyStart(std::string_view bytes) {
  if (!bytes.starts_with(kNpyMagic)) {
    return InvalidArray(WhyNotNpy(bytes));
  }
  const auto byte = [&](std::size_t i) {
    return static_cast<std::size_t>(static_cast<unsigned char>(bytes[i]));
  };
  if (bytes.size() < 8) return InvalidArray("the .npy header is cut short");
  const std::size_t version = byte(6);
  if (version < 1 || version > 3 || byte(7) != 0) {
    return InvalidArray("the .npy version is " + std::to_string(version) + "." +
                        std::to_string(byte(7)) + "; send 1.0, 2.0 or 3.0");
  }
  const std::size_t header_at = version == 1 ? 10 : 12;
  if (bytes.size() < header_at) return InvalidArray("the .npy header is cut short");
  std::size_t header_size = byte(8) | byte(9) << 8;
  if (version > 1) header_size |= byte(10) << 16 | byte(11) << 24;
  if (header_size > bytes.size() - header_at) {
    return InvalidArray("the .npy header is cut short: it has " + std::to_string(header_size) +
                        " bytes by its own count, and " + std::to_string(bytes.size() - header_at) +
                        " are there");
  }

  Outcome<NpyArray> array = HeaderParser(bytes.substr(header_at, header_size)).Parse();
  if (!array) return std::move(array).problem();
  const std::optional<std::uint64_t> data_bytes = TotalBytes(*array);
  if (!data_bytes) return InvalidArray("the array's shape overflows");
  return NpyStart{*std::move(array), header_at + header_size, *data_bytes};
}

Check NpyStart::CheckSize(std::uint64_t present_bytes) const {
  if (data_bytes == present_bytes) return std::nullopt;
  return InvalidArray("the array's shape and type make " + std::to_string(data_bytes) +
                      " bytes, and " + std::to_string(present_bytes) + " follow the header");
}

Outcome<NpyArray> ReadNpy(std::string_view bytes) {
  Outcome<NpyStart> start = ReadNpyStart(bytes);
  if (!start) return std::move(start).problem();
  start->array.data = bytes.substr(start->header_bytes);
  if (auto problem = start->CheckSize(start->array.data.size())) return *std::move(problem);
  return std::move(start->array);
}

std::string NpyHeader(std::string_view descr, std::span<const std::size_t> shape) {
  std::string header = "{'descr': " + std::string(descr) + ", 'fortran_order': False, 'shape': (";
  for (std::size_t i = 0; i < shape.size(); ++i) {
    if (i != 0) header += ' ';
    header += std::to_string(shape[i]);
    if (i + 1 < shape.size() || shape.size() == 1) header += ',';
  }
  header += "), }";

  constexpr std::size_t kPreamble = 10, kAlignment = 64;
  const std::size_t unpadded = kPreamble + header.size() + 1;
  header.append((kAlignment - unpadded % kAlignment) % kAlignment, ' ');
  header += '\n';

  std::string out(kNpyMagic);
  out += {'\x01', '\x00', static_cast<char>(header.size() & 0xff),
          static_cast<char>(header.size() >> 8)};
  return out + header;
}

}  // namespace kdray::api
