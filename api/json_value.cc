// SPDX-License-Identifier: Apache-2.0
#include "api/json_value.h"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>

namespace kdray::api {
namespace {

constexpr std::string_view kReplacement = "\xef\xbf\xbd";

/// The length of the UTF-8 sequence at the start of `text`; 0 if there is none (RFC 3629, 4).
std::size_t SequenceLength(std::string_view text) {
  const auto byte = [text](std::size_t i) {
    return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U;
  };
  const auto continues = [&](std::size_t i) { return (byte(i) & 0xc0U) == 0x80U; };
  const unsigned first = byte(0), second = byte(1);
  if (first < 0x80) return 1;
  if (first >= 0xc2 && first < 0xe0) return continues(1) ? 2 : 0;
  if (first >= 0xe0 && first < 0xf0) {
    const bool fits = first == 0xe0   ? second >= 0xa0  // else shorter
                      : first == 0xed ? second < 0xa0   // else a surrogate
                                      : true;
    return fits && continues(1) && continues(2) ? 3 : 0;
  }
  if (first >= 0xf0 && first < 0xf5) {
    const bool fits = first == 0xf0 ? second >= 0x90 : first == 0xf4 ? second < 0x90 : true;
    return fits && continues(1) && continues(2) && continues(3) ? 4 : 0;
  }
  return 0;
}

void AppendEscaped(std::string& out, char c) {
  constexpr std::string_view kEscaped = "\"\\\b\f\n\r\t", kLetters = "\"\\bfnrt";
  constexpr std::string_view kHex = "0123456789abcdef";
  if (const auto place = kEscaped.find(c); place != std::string_view::npos) {
    out += '\\';
    out += kLetters[place];
  } else if (static_cast<unsigned char>(c) < 0x20) {
    out += "\\u00";
    out += kHex[static_cast<unsigned char>(c) >> 4U];
    out += kHex[static_cast<unsigned char>(c) & 15U];
  } else {
    out += c;
  }
}

std::string Quoted(std::string_view text) {
  std::string out = "\"";
  while (!text.empty()) {
    const std::size_t length = SequenceLength(text);
    if (length == 1) {
      AppendEscaped(out, text[0]);
    } else {
      out += length == 0 ? kReplacement : text.substr(0, length);
    }
    text.remove_prefix(length == 0 ? 1 : length);
  }
  return out + '"';
}

/// The shortest digits that read back as the same number; with an exponent below 1e-4 and from 1e15
/// on.
std::string NumberText(double value) {
  if (!std::isfinite(value)) return "null";
  std::array<char, 32> text{};  // ends with zeros, for atoi
  char* const end =
      std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::scientific)
          .ptr;
  const std::string_view shortest(text.data(), static_cast<std::size_t>(end - text.data()));
  const std::size_t e = shortest.find('e');
  const int exponent = std::atoi(shortest.data() + e + 1);
  if (exponent < -4 || exponent >= 15) return std::string(shortest);
  std::string digits;
  for (const char c : shortest.substr(0, e)) {
    if (c >= '0' && c <= '9') digits += c;
  }
  const std::string sign = shortest[0] == '-' ? "-" : "";
  if (exponent < 0) {
    return sign + "0." + std::string(static_cast<std::size_t>(-exponent - 1), '0') + digits;
  }
  const auto whole = static_cast<std::size_t>(exponent) + 1;
  if (digits.size() <= whole) return sign + digits + std::string(whole - digits.size(), '0') + ".0";
  return sign + digits.substr(0, whole) + "." + digits.substr(whole);
}

}  // namespace

JsonValue::JsonValue(double value) : text_(NumberText(value)) {}
JsonValue::JsonValue(std::string_view value) : text_(Quoted(value)) {}

JsonValue::JsonValue(std::initializer_list<Member> members) : text_("{}") {
  for (const auto& [name, value] : members) Add(name, value);
}

JsonValue JsonValue::Empty(std::string_view brackets) {
  JsonValue value;
  value.text_ = brackets;
  return value;
}

void JsonValue::Add(std::string_view name, const JsonValue& value) {
  Insert(Quoted(name) + ":" + value.text_);
}

void JsonValue::Insert(std::string_view text) {
  const char bracket = text_.back();
  text_.back() = ',';
  if (text_.size() == 2) text_.pop_back();
  text_ += text;
  text_ += bracket;
}

}  // namespace kdray::api
