// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply_body.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "core/base/cancel_poll.h"
#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

std::string TooLong(std::int64_t items, std::size_t remaining) {
  return "a list of " + std::to_string(items) + " items does not fit into the " +
         std::to_string(remaining) + " bytes that follow";
}

TextCursor BodyCursor(std::string_view text, const PlyHeader& header, CancelPoll* poll) {
  return TextCursor(text.substr(header.body), {.hash_comments = true}, header.body_line, poll);
}

bool IsRemark(std::string_view word) {
  if (word.empty() || (word[0] != 'c' && word[0] != 'o')) return false;
  return word == "comment" || word == "obj_info";
}

// Moves to the next line with a value.
bool FindRow(TextCursor& cursor) {
  while (cursor.FindLineWithWords()) {
    if (cursor.Peek() != 'c' && cursor.Peek() != 'o') return true;
    TextCursor ahead = cursor;
    if (!IsRemark(ahead.NextWord())) return true;
    cursor.NextLine();
  }
  return false;
}

}  // namespace

PlyAsciiBody::PlyAsciiBody(std::string_view text, const PlyHeader& header, PlyLayout layout,
                           CancelPoll* poll)
    : cursor_(BodyCursor(text, header, poll)), layout_(layout) {}

bool PlyAsciiBody::Fail(Error cause) {
  error_ = AtLine(cursor_.line(), std::move(cause));
  return false;
}

std::string_view PlyAsciiBody::NextValue() {
  for (;;) {
    word_ = cursor_.NextWord();
    const bool remark = IsRemark(word_);
    if (!word_.empty() && !remark) return word_;
    word_ = {};
    if (!IsFree() || cursor_.AtEnd()) return word_;
    cursor_.NextLine();
  }
}

bool PlyAsciiBody::BeginRow() {
  return FindRow(cursor_) || Fail("the file ends before its last row");
}

bool PlyAsciiBody::EndRow() {
  if (IsFree()) return true;
  if (layout_ == PlyLayout::kEvenLines && !NextValue().empty()) {
    return Fail(Quoted(word_) + " follows the row's last value");
  }
  cursor_.NextLine();
  return true;
}

bool PlyAsciiBody::EndElement() {
  if (layout_ != PlyLayout::kWords) return true;
  const std::string_view word = TextCursor(cursor_).NextWord();
  return word.empty() || IsRemark(word) || Fail("text follows an element's last row on its line");
}

bool PlyAsciiBody::ReadNumber(PlyType, double* value) {
  const std::string_view word = NextValue();
  const std::optional<double> number = ParseCoordinate(word);
  if (!number) return Fail(WhyNotNumber(word));
  *value = *number;
  return true;
}

bool PlyAsciiBody::ReadLength(const PlyProperty& list, std::uint64_t* length) {
  std::int64_t number = 0;
  if (!ReadIndex(*list.count_type, &number)) return false;
  if (number < 0) return Fail("a list cannot have " + std::to_string(number) + " items");
  if (static_cast<std::uint64_t>(number) > remaining() / 2) {
    return Fail(TooLong(number, remaining()));
  }
  *length = static_cast<std::uint64_t>(number);
  return true;
}

bool PlyAsciiBody::ReadIndex(PlyType, std::int64_t* index) {
  const std::string_view word = NextValue();
  const std::optional<std::int64_t> number = ParseInteger(word);
  if (!number) return Fail(WhyNotInteger(word));
  *index = *number;
  return true;
}

bool PlyAsciiBody::Skip(const PlyProperty& property) {
  std::uint64_t count = 1;
  if (property.IsList() && !ReadLength(property, &count)) return false;
  return SkipItems(property.type, count);
}

bool PlyAsciiBody::SkipItems(PlyType, std::uint64_t count) {
  for (std::uint64_t i = 0; i < count; ++i) {
    if (NextValue().empty()) return Fail("a number is missing");
  }
  return true;
}

Result<PlyLines> CountPlyLines(std::string_view text, const PlyHeader& header, std::uint64_t most,
                               const CancelToken& cancel) {
  CancelPoll poll(cancel);
  TextCursor cursor = BodyCursor(text, header, &poll);
  PlyLines lines;
  std::uint64_t first = 0;
  std::uint64_t last = 0;
  for (; lines.count < most && FindRow(cursor); cursor.NextLine()) {
    lines.even = lines.even && last == first;
    last = 0;
    while (!cursor.NextWord().empty()) ++last;
    if (lines.count++ == 0) first = last;
  }
  if (poll.stopped()) return poll.ToError();
  lines.even = lines.even && last <= first;
  return lines;
}

PlyBinaryBody::PlyBinaryBody(std::string_view bytes, const PlyHeader& header)
    : bytes_(bytes),
      swap_((header.format == PlyFormat::kBigEndian) != (std::endian::native == std::endian::big)),
      position_(header.body),
      last_(header.body) {}

bool PlyBinaryBody::Fail(Error cause) {
  error_ = AtByte(last_, std::move(cause));
  return false;
}

std::size_t PlyBinaryBody::LeastBytes(const PlyElement& element) {
  std::size_t bytes = 0;
  for (const PlyProperty& property : element.properties) {
    bytes += SizeOf(property.count_type.value_or(property.type));
  }
  return bytes;
}

bool PlyBinaryBody::FailTooShort(std::uint64_t bytes) {
  return Fail("the file ends here, where " + std::to_string(bytes) + " more bytes are needed");
}

template <class T>
T PlyBinaryBody::Take() {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes_.data() + position_, sizeof(T));
  position_ += sizeof(T);
  if (swap_) std::reverse(raw.begin(), raw.end());
  return std::bit_cast<T>(raw);
}

bool PlyBinaryBody::ReadNumber(PlyType type, double* value) {
  if (!Has(SizeOf(type))) return false;
  switch (type) {
    case PlyType::kFloat32:
      *value = static_cast<double>(Take<float>());
      return true;
    case PlyType::kFloat64:
      *value = Take<double>();
      return true;
    case PlyType::kUint64:
      *value = static_cast<double>(Take<std::uint64_t>());
      return true;
    default: {
      std::int64_t integer = 0;
      if (!ReadIndex(type, &integer)) return false;
      *value = static_cast<double>(integer);
      return true;
    }
  }
}

bool PlyBinaryBody::ReadIndex(PlyType type, std::int64_t* index) {
  if (!Has(SizeOf(type))) return false;
  switch (type) {
    case PlyType::kInt8:
      *index = Take<std::int8_t>();  // NOLINT(bugprone-signed-char-misuse): a number, with its sign
      return true;
    case PlyType::kUint8:
      *index = Take<std::uint8_t>();
      return true;
    case PlyType::kInt16:
      *index = Take<std::int16_t>();
      return true;
    case PlyType::kUint16:
      *index = Take<std::uint16_t>();
      return true;
    case PlyType::kInt32:
      *index = Take<std::int32_t>();
      return true;
    case PlyType::kUint32:
      *index = Take<std::uint32_t>();
      return true;
    case PlyType::kInt64:
      *index = Take<std::int64_t>();
      return true;
    case PlyType::kUint64: {
      const auto value = Take<std::uint64_t>();
      if (value > std::uint64_t{std::numeric_limits<std::int64_t>::max()}) {
        return Fail("the integer " + std::to_string(value) + " is beyond 2^63");
      }
      *index = static_cast<std::int64_t>(value);
      return true;
    }
    case PlyType::kFloat32:
    case PlyType::kFloat64:
      break;
  }
  return Fail("an index cannot be a fraction");
}

bool PlyBinaryBody::ReadLength(const PlyProperty& list, std::uint64_t* length) {
  std::int64_t number = 0;
  if (!ReadIndex(*list.count_type, &number)) return false;
  if (number < 0) return Fail("a list cannot have " + std::to_string(number) + " items");
  if (static_cast<std::uint64_t>(number) > remaining() / SizeOf(list.type)) {
    return Fail(TooLong(number, remaining()));
  }
  *length = static_cast<std::uint64_t>(number);
  return true;
}

bool PlyBinaryBody::Skip(const PlyProperty& property) {
  std::uint64_t count = 1;
  if (property.IsList() && !ReadLength(property, &count)) return false;
  return SkipItems(property.type, count);
}

bool PlyBinaryBody::SkipItems(PlyType type, std::uint64_t count) {
  const std::uint64_t bytes = count * SizeOf(type);  // ReadLength has bounded the count
  if (!Has(bytes)) return false;
  position_ += bytes;
  return true;
}

}  // namespace kdray::core
