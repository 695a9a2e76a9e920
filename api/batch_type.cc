// SPDX-License-Identifier: Apache-2.0
#include "api/batch_type.h"

#include <algorithm>
#include <charconv>
#include <string>
#include <utility>

#include "api/npy.h"
#include "api/quoted.h"

namespace kdray::api {
namespace {

constexpr std::string_view kJsonType = "application/json";
constexpr std::string_view kNpyType = "application/x-npy";

std::string_view Trim(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

std::string Lower(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  });
  return lower;
}

/// Removes and returns the text before the first `separator`.
std::string_view Next(std::string_view* rest, char separator) {
  const std::size_t end = rest->find(separator);
  const std::string_view part = rest->substr(0, end);
  rest->remove_prefix(end == std::string_view::npos ? rest->size() : end + 1);
  return Trim(part);
}

/// The q-value among a media range's parameters; 1 if absent. An invalid value counts as absent, as
/// for servers that ignore an invalid Accept.
double Quality(std::string_view parameters) {
  while (!parameters.empty()) {
    std::string_view parameter = Next(&parameters, ';');
    const std::string name = Lower(Next(&parameter, '='));
    if (name != "q") continue;
    const std::string_view value = Trim(parameter);
    double q = 1;
    const auto [end, error] =
        std::from_chars(value.data(), value.data() + value.size(), q, std::chars_format::fixed);
    if (error != std::errc() || end != value.data() + value.size() || !(q >= 0 && q <= 1)) return 1;
    return q;
  }
  return 1;
}

/// Accept's preference for one media type: the q-value of the most specific range that includes it;
/// 0 if none does.
class Preference {
 public:
  explicit Preference(std::string_view type) : type_(type) {}

  void See(const std::string& range, double quality) {
    const int specific = range == type_ ? 3 : range == "application/*" ? 2 : range == "*/*" ? 1 : 0;
    if (specific == 0 || specific < specific_) return;
    quality_ = specific == specific_ ? std::max(quality_, quality) : quality;
    specific_ = specific;
  }
  double quality() const { return quality_; }
  bool named() const { return specific_ == 3; }

 private:
  std::string_view type_;
  int specific_ = 0;
  double quality_ = 0;
};

/// The body's media type by Content-Type, in lower case and without parameters; empty if absent, or
/// one of curl's defaults.
std::string NamedType(std::optional<std::string_view> content_type) {
  std::string_view rest = content_type.value_or("");
  std::string type = Lower(Next(&rest, ';'));
  const bool unnamed =
      type == "application/octet-stream" || type == "application/x-www-form-urlencoded";
  return unnamed ? "" : type;
}

Problem Unsupported(std::string_view named, std::string_view wanted) {
  return Problem{
      ErrorCode::kUnsupportedMediaType,
      "the body is named " + Quoted(named) + "; send " + std::string(wanted) + ", or name nothing",
      "Content-Type"};
}

}  // namespace

std::string_view ContentType(BatchType type) {
  return type == BatchType::kJson ? kJsonType : kNpyType;
}

Outcome<BatchType> DetectBatchType(std::string_view body,
                                   std::optional<std::string_view> content_type) {
  const std::string named = NamedType(content_type);
  if (!named.empty() && named != kJsonType && named != kNpyType) {
    return Unsupported(named, "application/json or application/x-npy");
  }
  // One byte is enough, because JSON cannot begin with 0x93; so a truncated file gets the right
  // error.
  if (!body.empty() && body.front() == kNpyMagic.front()) return BatchType::kNpy;
  // Archives and compressed data are not JSON either, whatever Content-Type says; the reader of
  // .npy says what they are.
  if (body.starts_with("PK\x03\x04") || body.starts_with("\x1f\x8b")) return BatchType::kNpy;
  if (named != kNpyType) return BatchType::kJson;
  const std::size_t first = body.find_first_not_of(" \t\r\n");
  const bool is_object = first != std::string_view::npos && body[first] == '{';
  return is_object ? BatchType::kJson : BatchType::kNpy;
}

Check CheckJsonContentType(std::optional<std::string_view> content_type) {
  const std::string named = NamedType(content_type);
  if (named.empty() || named == kJsonType) return std::nullopt;
  return Unsupported(named, kJsonType);
}

Outcome<BatchType> ChooseAnswerType(std::optional<std::string_view> accept, BatchType request) {
  std::string_view rest = accept.value_or("");
  Preference json(kJsonType), npy(kNpyType);
  bool empty = true;
  while (!rest.empty()) {
    std::string_view element = Next(&rest, ',');
    const std::string range = Lower(Next(&element, ';'));
    if (range.empty()) continue;
    empty = false;
    const double quality = Quality(element);
    json.See(range, quality);
    npy.See(range, quality);
  }
  if (empty) return request;
  if (json.quality() == 0 && npy.quality() == 0) {
    return Problem{ErrorCode::kNotAcceptable,
                   "Accept is " + Quoted(*accept) +
                       "; the answer can be application/json or application/x-npy",
                   "Accept"};
  }
  // At equal quality a named type precedes one that a wildcard includes.
  const std::pair json_rank(json.quality(), json.named()), npy_rank(npy.quality(), npy.named());
  if (json_rank == npy_rank) return request;
  return json_rank > npy_rank ? BatchType::kJson : BatchType::kNpy;
}

}  // namespace kdray::api
