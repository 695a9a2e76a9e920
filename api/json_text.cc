#include "api/json_text.h"

#include <charconv>
#include <cmath>

namespace kdray::api {
namespace {

template <class T>
void Append(std::string* out, T value) {
  char text[32];  // the longest double, -2.2250738585072014e-308, has 24 characters
  const std::to_chars_result end = std::to_chars(text, text + sizeof(text), value);
  out->append(text, end.ptr);
}

template <class T>
void AppendFloating(std::string* out, T value) {
  if (std::isfinite(value)) {
    Append(out, value + T{0});
  } else {
    *out += "null";
  }
}

}  // namespace

void AppendNumber(std::string* out, double value) { AppendFloating(out, value); }
void AppendNumber(std::string* out, float value) { AppendFloating(out, value); }
std::string NumberText(double value) {
  std::string text;
  AppendNumber(&text, value);
  return text;
}
void AppendInteger(std::string* out, std::int64_t value) { Append(out, value); }

void AppendRowLists(std::string* out, const std::vector<std::uint64_t>& invalid) {
  *out += "\"invalid\":[";
  for (std::size_t i = 0; i < invalid.size(); ++i) {
    if (i != 0) *out += ',';
    Append(out, invalid[i]);
  }
  // Only queries that truncate rows have entries.
  *out += "],\"truncated\":[]";
}

}  // namespace kdray::api
