// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_json_source.h"

#include <algorithm>

namespace kdray::core {
namespace {

constexpr std::size_t kPiece = std::size_t{1} << 16;
// Of parsing a character (CancelPoll).
constexpr std::uint64_t kCharacterWork = 4;

// The position of the quote that ends the string which begins before `begin`; npos without one.
std::size_t FindQuote(std::string_view text, std::size_t begin, CancelPoll* poll) {
  while (begin < text.size()) {
    const std::size_t found =
        text.substr(0, std::min(begin + kPiece, text.size())).find_first_of("\"\\", begin);
    if (poll->Spend(std::min(found, begin + kPiece) - begin + 1)) break;
    if (found == std::string_view::npos) {
      begin += kPiece;
    } else if (text[found] == '"') {
      return found;
    } else {
      begin = found + 2;
    }
  }
  return std::string_view::npos;
}

}  // namespace

void JsonSource::Refill() {
  if (next_ >= text_.size()) return End();
  const std::size_t begin = next_;
  if (text_[begin] != '"') {
    // Up to the next string.
    const std::string_view piece = text_.substr(begin, kPiece);
    next_ = begin + std::min(piece.find('"'), piece.size());
    if (poll_->Spend((next_ - begin) * kCharacterWork)) return End();
    const bool is_one_word =
        next_ - begin == kPiece && piece.find_first_of(" \t\r\n,:[]{}") == std::string_view::npos;
    return is_one_word ? End() : Give(text_.substr(begin, next_ - begin), true, begin);
  }
  const std::size_t quote = FindQuote(text_, begin + 1, poll_);
  if (quote == std::string_view::npos) return End();
  next_ = quote + 1;
  const std::string_view content = text_.substr(begin + 1, quote - begin - 1);
  if (content.starts_with("data:")) {
    replacement_ = "\"data:#" + std::to_string(uris_.size()) + "\"";
    uris_.push_back(content);
  } else if (content.size() > kLongestString) {
    replacement_ = "\"\"";
  } else {
    if (poll_->Spend(content.size() * kCharacterWork)) return End();
    return Give(text_.substr(begin, next_ - begin), true, begin);
  }
  Give(replacement_, false, begin);
}

}  // namespace kdray::core
