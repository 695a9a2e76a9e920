// SPDX-License-Identifier: Apache-2.0
#include "kdray/npy.h"

#include <bit>
#include <charconv>

#include "kdray/error.h"

namespace kdray::client {
namespace {

[[noreturn]] void Reject(const std::string& why) {
  throw LocalFileError("not a .npy file: " + why);
}

// Parses the header's text, a Python dictionary literal with three keys, as NumPy writes it.
class HeaderReader {
 public:
  explicit HeaderReader(std::string_view text) : text_(text) {}

  NpyHeader Read() {
    NpyHeader header;
    bool has_descr = false;
    bool has_order = false;
    bool has_shape = false;
    Expect('{');
    while (!TakeIf('}')) {
      const std::string_view key = Quoted();
      Expect(':');
      if (key == "descr") {
        header.descr = Peek() == '\'' || Peek() == '"' ? std::string(Quoted()) : List();
        has_descr = true;
      } else if (key == "fortran_order") {
        header.fortran_order = Boolean();
        has_order = true;
      } else if (key == "shape") {
        header.shape = Shape();
        has_shape = true;
      } else {
        Reject("unknown header key");
      }
      if (!TakeIf(',')) {
        Expect('}');
        break;
      }
    }
    if (!has_descr || !has_order || !has_shape) Reject("descr, fortran_order or shape is missing");
    return header;
  }

 private:
  char Peek() {
    while (!text_.empty() && (text_[0] == ' ' || text_[0] == '\n')) text_.remove_prefix(1);
    if (text_.empty()) Reject("its header ends too early");
    return text_[0];
  }

  bool TakeIf(char c) {
    if (Peek() != c) return false;
    text_.remove_prefix(1);
    return true;
  }

  void Expect(char c) {
    if (!TakeIf(c)) Reject(std::string("its header lacks a '") + c + "'");
  }

  std::string_view Quoted() {
    const char quote = Peek();
    if (quote != '\'' && quote != '"') Reject("its header lacks a quoted word");
    const std::size_t end = text_.find(quote, 1);
    if (end == std::string_view::npos) Reject("a quote in its header is not closed");
    const std::string_view word = text_.substr(1, end - 1);
    text_.remove_prefix(end + 1);
    return word;
  }

  // A structured type: everything up to its closing bracket.
  std::string List() {
    if (Peek() != '[') Reject("its descr is neither a word nor a list");
    int depth = 0;
    for (std::size_t i = 0; i < text_.size(); ++i) {
      if (text_[i] == '[') ++depth;
      if (text_[i] == ']' && --depth == 0) {
        std::string list(text_.substr(0, i + 1));
        text_.remove_prefix(i + 1);
        return list;
      }
    }
    Reject("the list in its descr is not closed");
  }

  bool Boolean() {
    Peek();
    for (const bool value : {false, true}) {
      const std::string_view word = value ? "True" : "False";
      if (!text_.starts_with(word)) continue;
      text_.remove_prefix(word.size());
      return value;
    }
    Reject("fortran_order is neither True nor False");
  }

  std::vector<std::uint64_t> Shape() {
    std::vector<std::uint64_t> shape;
    Expect('(');
    while (!TakeIf(')')) {
      std::uint64_t extent = 0;
      Peek();
      const auto [end, error] = std::from_chars(text_.data(), text_.data() + text_.size(), extent);
      if (error != std::errc()) Reject("an extent of its shape is not a number");
      text_.remove_prefix(static_cast<std::size_t>(end - text_.data()));
      shape.push_back(extent);
      if (!TakeIf(',')) {
        Expect(')');
        break;
      }
    }
    return shape;
  }

  std::string_view text_;
};

// Compilers make one copy of it where memory has this order.
template <class Bits, class Number>
std::string LittleEndian(std::span<const Number> values) {
  std::string out(values.size_bytes(), '\0');
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto bits = std::bit_cast<Bits>(values[i]);
    for (std::size_t byte = 0; byte < sizeof(Bits); ++byte) {
      out[i * sizeof(Bits) + byte] = static_cast<char>(bits >> (8 * byte));
    }
  }
  return out;
}

}  // namespace

std::uint64_t NpyHeader::ElementCount() const {
  std::uint64_t count = 1;
  for (const std::uint64_t extent : shape) count *= extent;
  return count;
}

NpyHeader ParseNpyHeader(std::string_view bytes) {
  const auto byte = [&](std::size_t i) {
    return static_cast<std::size_t>(static_cast<unsigned char>(bytes[i]));
  };
  if (!bytes.starts_with(kNpyMagic)) Reject("it does not begin with the magic bytes");
  if (bytes.size() < 12) Reject("it ends within its header");
  const std::size_t version = byte(6);
  if (version < 1 || version > 3) Reject("its format version is not 1, 2 or 3");
  const std::size_t begin = version == 1 ? 10 : 12;
  const std::size_t length = version == 1
                                 ? byte(8) | byte(9) << 8
                                 : byte(8) | byte(9) << 8 | byte(10) << 16 | byte(11) << 24;
  if (bytes.size() - begin < length) Reject("it ends within its header");
  NpyHeader header = HeaderReader(bytes.substr(begin, length)).Read();
  header.data_offset = begin + length;
  return header;
}

std::string EncodeNpyHeader(const NpyHeader& header) {
  std::string text = "{'descr': ";
  text += header.descr.starts_with('[') ? header.descr : "'" + header.descr + "'";
  text += header.fortran_order ? ", 'fortran_order': True" : ", 'fortran_order': False";
  text += ", 'shape': (";
  for (const std::uint64_t extent : header.shape) text += std::to_string(extent) + ",";
  text += "), }";
  constexpr std::size_t kPreamble = 10;
  while ((kPreamble + text.size() + 1) % 64 != 0) text += ' ';
  text += '\n';
  std::string out(kNpyMagic);
  out += {'\1', '\0', static_cast<char>(text.size() & 255), static_cast<char>(text.size() >> 8)};
  return out + text;
}

std::string LittleEndianFloats(std::span<const float> values) {
  return LittleEndian<std::uint32_t>(values);
}

std::string LittleEndianDoubles(std::span<const double> values) {
  return LittleEndian<std::uint64_t>(values);
}

}  // namespace kdray::client
