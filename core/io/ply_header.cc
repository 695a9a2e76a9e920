// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply_header.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "core/io/mesh_error.h"
#include "core/io/parse_text.h"

namespace kdray::core {
namespace {

// A real header has some dozens of properties. The limit keeps a hostile header from using more
// memory than it has bytes.
constexpr std::size_t kMaxProperties = 1024;

std::optional<PlyType> ParseType(std::string_view word) {
  struct Named {
    std::string_view name;
    PlyType type;
  };
  static constexpr std::array<Named, 22> kTypes = {{
      {"char", PlyType::kInt8},      {"int8", PlyType::kInt8},
      {"uchar", PlyType::kUint8},    {"uint8", PlyType::kUint8},
      {"short", PlyType::kInt16},    {"int16", PlyType::kInt16},
      {"ushort", PlyType::kUint16},  {"uint16", PlyType::kUint16},
      {"int", PlyType::kInt32},      {"int32", PlyType::kInt32},
      {"uint", PlyType::kUint32},    {"uint32", PlyType::kUint32},
      {"long", PlyType::kInt64},     {"int64", PlyType::kInt64},
      {"longlong", PlyType::kInt64}, {"ulong", PlyType::kUint64},
      {"uint64", PlyType::kUint64},  {"ulonglong", PlyType::kUint64},
      {"float", PlyType::kFloat32},  {"float32", PlyType::kFloat32},
      {"double", PlyType::kFloat64}, {"float64", PlyType::kFloat64},
  }};
  const auto* found = std::find_if(kTypes.begin(), kTypes.end(),
                                   [&](const Named& named) { return named.name == word; });
  if (found == kTypes.end()) return std::nullopt;
  return found->type;
}

std::optional<PlyFormat> ParseFormat(std::string_view word) {
  if (word == "ascii") return PlyFormat::kAscii;
  if (word == "binary_little_endian") return PlyFormat::kLittleEndian;
  if (word == "binary_big_endian") return PlyFormat::kBigEndian;
  return std::nullopt;
}

// A longer line is a remark only with the keyword of one.
constexpr std::size_t kLongestRemark = std::size_t{1} << 16;

class HeaderParser {
 public:
  HeaderParser(std::string_view text, CancelPoll* poll) : text_(text), poll_(poll) {
    const std::size_t end = std::min(text.find('\r'), text.find('\n'));
    const bool only_cr =
        end != std::string_view::npos && text[end] == '\r' && text.substr(end, 2) != "\r\n";
    line_end_ = only_cr ? '\r' : '\n';
  }

  Result<PlyHeader> Parse() {
    while (!done_) {
      const std::size_t end = text_.find(line_end_, position_);
      if (end == std::string_view::npos) {
        return AtLine(line_ + 1, "the PLY header has no end_header");
      }
      std::string_view line = text_.substr(position_, end - position_);
      if (poll_->Spend(64 + line.size() / 8)) return poll_->ToError();
      if (line.ends_with('\r')) line.remove_suffix(1);
      position_ = end + 1;
      ++line_;
      if (Status status = ParseLine(line); !status.ok()) {
        return AtLine(line_, std::move(status).error());
      }
    }
    if (!has_format_) return AtLine(line_, "the PLY header has no format line");
    header_.body = position_;
    header_.body_line = line_ + 1;
    return std::move(header_);
  }

 private:
  static Error Broken(std::string cause) {
    return Error{ErrorCode::kInvalidMesh, std::move(cause)};
  }

  Status ParseLine(std::string_view line) {
    TextCursor words(line, {}, 1, poll_);
    const std::string_view keyword = words.NextWord();
    if (line_ == 1) {
      if (keyword != "ply") return Broken("a PLY file begins with 'ply'");
      return {};
    }
    if (keyword.empty() || keyword == "comment" || keyword == "obj_info") return {};
    if (keyword == "end_header") {
      done_ = true;
      return {};
    }
    if (keyword == "format") return ParseFormatLine(words);
    if (keyword == "element") return ParseElementLine(words);
    if (keyword == "property") return ParsePropertyLine(words);
    if (IsRemark(line)) return {};
    return Broken(
        Quoted(keyword) +
        " does not begin a line of a PLY header; allowed are format, element, property, comment, "
        "obj_info, end_header");
  }

  // Text that cannot be a declaration, which contains a type or `list`, or ends with a count.
  bool IsRemark(std::string_view line) const {
    if (line.size() > kLongestRemark) return false;
    const bool is_text = std::all_of(line.begin(), line.end(), [](char c) {
      return static_cast<unsigned char>(c) >= ' ' || c == '\t';
    });
    TextCursor words(line, {}, 1, poll_);
    words.NextWord();
    const std::string_view second = words.NextWord();
    const bool is_element = ParseInteger(words.NextWord()) && words.NextWord().empty();
    return is_text && second != "list" && !ParseType(second) && !is_element;
  }

  Status ParseFormatLine(TextCursor& words) {
    const std::string_view name = words.NextWord();
    const std::optional<PlyFormat> format = ParseFormat(name);
    if (!format) {
      return Broken(Quoted(name) +
                    " is not a format; allowed are ascii, binary_little_endian, binary_big_endian");
    }
    if (words.NextWord() != "1.0") return Broken("the format's version is not 1.0");
    if (has_format_) return Broken("a second format line");
    header_.format = *format;
    has_format_ = true;
    return {};
  }

  Status ParseElementLine(TextCursor& words) {
    PlyElement element;
    element.name = words.NextWord();
    element.line = line_;
    if (element.name.empty()) return Broken("the element has no name");
    const bool is_needed = element.name == "vertex" || element.name == "face";
    if (is_needed && header_.Find(element.name) != nullptr) {
      return Broken("a second element " + Quoted(element.name));
    }
    const std::string_view word = words.NextWord();
    const std::optional<std::int64_t> count = ParseInteger(word);
    if (!count) return Broken(WhyNotInteger(word));
    if (*count < 0) return Broken("an element cannot have " + Quoted(word) + " rows");
    element.count = static_cast<std::uint64_t>(*count);
    if (Status status = CountOneMore(); !status.ok()) return status;
    header_.elements.push_back(std::move(element));
    return {};
  }

  Status ParsePropertyLine(TextCursor& words) {
    if (header_.elements.empty()) return Broken("a property without an element");
    PlyProperty property;
    property.line = line_;
    std::string_view word = words.NextWord();
    if (word == "list") {
      word = words.NextWord();
      property.count_type = ParseType(word);
      if (!property.count_type || !IsInteger(*property.count_type)) {
        return Broken(Quoted(word) + " is not an integer type, which a list's length must have");
      }
      word = words.NextWord();
    }
    const std::optional<PlyType> type = ParseType(word);
    if (!type) return Broken(Quoted(word) + " is not a type of PLY");
    property.type = *type;
    property.name = words.NextWord();
    if (property.name.empty()) return Broken("the property has no name");
    PlyElement& element = header_.elements.back();
    if (Status status = CountOneMore(); !status.ok()) return status;
    element.properties.push_back(property);
    return {};
  }

  Status CountOneMore() {
    if (++declared_ <= kMaxProperties) return {};
    return Broken("more than " + std::to_string(kMaxProperties) + " elements and properties");
  }

  std::string_view text_;
  CancelPoll* poll_;
  char line_end_ = '\n';
  std::size_t position_ = 0;
  std::uint64_t line_ = 0;
  std::size_t declared_ = 0;
  bool has_format_ = false;
  bool done_ = false;
  PlyHeader header_;
};

}  // namespace

std::optional<std::size_t> PlyElement::Find(std::string_view property, std::size_t begin) const {
  for (std::size_t i = begin; i < properties.size(); ++i) {
    if (properties[i].name == property) return i;
  }
  return std::nullopt;
}

const PlyElement* PlyHeader::Find(std::string_view element) const {
  for (const PlyElement& candidate : elements) {
    if (candidate.name == element) return &candidate;
  }
  return nullptr;
}

Result<PlyHeader> ParsePlyHeader(std::string_view text, CancelPoll* poll) {
  Result<PlyHeader> header = HeaderParser(text, poll).Parse();
  if (poll->stopped()) return poll->ToError();
  return header;
}

}  // namespace kdray::core
