// SPDX-License-Identifier: Apache-2.0
// The tokens of --token-file, which authorise clients.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <string_view>
#include <vector>

#include "core/base/hash.h"
#include "core/base/result.h"

namespace kdray::server {

/// Immutable, so safe from many threads at once. Keeps hashes, not tokens.
class BearerTokens {
 public:
  /// One token per line; blank lines and lines that begin with '#' are skipped. kInvalidArgument
  /// for a text without tokens, or a token with characters that a header cannot contain.
  static core::Result<BearerTokens> Parse(std::string_view text);

  /// Whether the value of an Authorization header is `Bearer TOKEN` with one of the tokens. Its
  /// time reveals only the number of tokens.
  bool Allows(std::optional<std::string_view> authorization) const;

 private:
  std::vector<core::Sha256Digest> digests_;
};

/// Tokens that may be replaced while requests are checked. Safe from many threads at once.
class TokenGate {
 public:
  explicit TokenGate(BearerTokens tokens);

  /// As BearerTokens::Allows().
  bool Allows(std::optional<std::string_view> authorization) const;
  void Replace(BearerTokens tokens);

 private:
  std::shared_ptr<const BearerTokens> Current() const;

  mutable std::mutex mutex_;
  std::shared_ptr<const BearerTokens> tokens_;
};

}  // namespace kdray::server
