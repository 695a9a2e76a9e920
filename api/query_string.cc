// SPDX-License-Identifier: Apache-2.0
#include "api/query_string.h"

#include <optional>
#include <unordered_set>
#include <utility>

#include "api/quoted.h"

namespace kdray::api {
namespace {

int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::optional<std::string> Decode(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i];
    } else {
      const int high = i + 2 < text.size() ? HexDigit(text[i + 1]) : -1;
      const int low = i + 2 < text.size() ? HexDigit(text[i + 2]) : -1;
      if (high < 0 || low < 0) return std::nullopt;
      out += static_cast<char>(16 * high + low);
      i += 2;
    }
  }
  return out;
}

}  // namespace

Outcome<std::vector<Parameter>> ParseQuery(std::string_view query) {
  std::vector<Parameter> parameters;
  std::unordered_set<std::string> names;
  while (!query.empty()) {
    const std::size_t end = query.find('&');
    const std::string_view piece = query.substr(0, end);
    query.remove_prefix(end == std::string_view::npos ? query.size() : end + 1);
    if (piece.empty()) continue;

    const std::size_t equals = piece.find('=');
    std::optional<std::string> name = Decode(piece.substr(0, equals));
    std::optional<std::string> value =
        Decode(equals == std::string_view::npos ? "" : piece.substr(equals + 1));
    if (!name || !value) {
      return Problem{ErrorCode::kInvalidParameter,
                     "a '%' without two hexadecimal digits after it in " + Quoted(piece), name};
    }
    if (!names.insert(*name).second) {
      return Problem{ErrorCode::kInvalidParameter,
                     "the parameter " + Quoted(*name) + " was given twice", name};
    }
    parameters.push_back({*std::move(name), *std::move(value)});
  }
  return parameters;
}

}  // namespace kdray::api
