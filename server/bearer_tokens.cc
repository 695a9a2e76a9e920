// SPDX-License-Identifier: Apache-2.0
#include "server/bearer_tokens.h"

#include <algorithm>
#include <span>
#include <string>
#include <utility>

#include "server/http/message.h"

namespace kdray::server {
namespace {

core::Sha256Digest Digest(std::string_view token) {
  return core::HashBytes(std::as_bytes(std::span(token)));
}

/// Compares every byte, whatever the first ones are.
bool EqualInConstantTime(const core::Sha256Digest& a, const core::Sha256Digest& b) {
  unsigned difference = 0;
  for (std::size_t i = 0; i < a.bytes.size(); ++i) {
    difference |= static_cast<unsigned>(a.bytes[i] ^ b.bytes[i]);
  }
  return difference == 0;
}

}  // namespace

core::Result<BearerTokens> BearerTokens::Parse(std::string_view text) {
  BearerTokens tokens;
  for (std::uint64_t number = 1; !text.empty(); ++number) {
    const auto feed = text.find('\n');
    std::string_view line = text.substr(0, feed);
    text.remove_prefix(feed == std::string_view::npos ? text.size() : feed + 1);
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty() || line.starts_with('#')) continue;
    if (!std::all_of(line.begin(), line.end(), [](char c) { return c > ' ' && c < '\x7f'; })) {
      return core::Error{.code = core::ErrorCode::kInvalidArgument,
                         .message = "a token may contain only printable ASCII without blanks",
                         .line = number};
    }
    tokens.digests_.push_back(Digest(line));
  }
  if (tokens.digests_.empty()) {
    return core::Error{.code = core::ErrorCode::kInvalidArgument, .message = "there is no token"};
  }
  return tokens;
}

bool BearerTokens::Allows(std::optional<std::string_view> authorization) const {
  constexpr std::string_view kScheme = "Bearer ";
  if (!authorization || authorization->size() <= kScheme.size() ||
      !EqualsIgnoringCase(authorization->substr(0, kScheme.size()), kScheme)) {
    return false;
  }
  const core::Sha256Digest given = Digest(authorization->substr(kScheme.size()));
  bool allowed = false;
  for (const core::Sha256Digest& digest : digests_) {
    allowed |= EqualInConstantTime(digest, given);
  }
  return allowed;
}

TokenGate::TokenGate(BearerTokens tokens)
    : tokens_(std::make_shared<const BearerTokens>(std::move(tokens))) {}

bool TokenGate::Allows(std::optional<std::string_view> authorization) const {
  return Current()->Allows(authorization);
}

void TokenGate::Replace(BearerTokens tokens) {
  auto replaced = std::make_shared<const BearerTokens>(std::move(tokens));
  const std::lock_guard lock(mutex_);
  tokens_.swap(replaced);
}

std::shared_ptr<const BearerTokens> TokenGate::Current() const {
  const std::lock_guard lock(mutex_);
  return tokens_;
}

}  // namespace kdray::server
