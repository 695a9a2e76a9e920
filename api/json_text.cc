// SPDX-License-Identifier: Apache-2.0
#include "api/json_text.h"

#include <charconv>
#include <cmath>

namespace kdray::api {
namespace {

template <class T>
char* PutDigits(char* out, T value) {
  return std::to_chars(out, out + kMostNumberBytes, value).ptr;
}

template <class T>
char* PutFloating(char* out, T value) {
  return std::isfinite(value) ? PutDigits(out, value + T{0}) : PutWord(out, "null");
}

/// Appends what put(out) writes: at most kMostNumberBytes.
template <class Put>
void Append(std::string* out, const Put& put) {
  char text[kMostNumberBytes];
  out->append(text, put(text));
}

void AppendRows(std::string* out, const std::vector<std::uint64_t>& rows) {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i != 0) *out += ',';
    AppendInteger(out, static_cast<std::int64_t>(rows[i]));
  }
}

}  // namespace

char* PutNumber(char* out, double value) { return PutFloating(out, value); }
char* PutNumber(char* out, float value) { return PutFloating(out, value); }
char* PutInteger(char* out, std::int64_t value) { return PutDigits(out, value); }

void AppendNumber(std::string* out, double value) {
  Append(out, [value](char* text) { return PutNumber(text, value); });
}
void AppendNumber(std::string* out, float value) {
  Append(out, [value](char* text) { return PutNumber(text, value); });
}
std::string NumberText(double value) {
  std::string text;
  AppendNumber(&text, value);
  return text;
}
void AppendInteger(std::string* out, std::int64_t value) {
  Append(out, [value](char* text) { return PutInteger(text, value); });
}

void AppendRowLists(std::string* out, const std::vector<std::uint64_t>& invalid,
                    const std::vector<std::uint64_t>& truncated) {
  *out += "\"invalid\":[";
  AppendRows(out, invalid);
  *out += "],\"truncated\":[";
  AppendRows(out, truncated);
  *out += ']';
}

}  // namespace kdray::api
