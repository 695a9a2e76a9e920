// Who may use the server: the tokens of --token-file.
#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "core/base/hash.h"
#include "core/base/result.h"

namespace kdray::server {

/// Immutable: safe from many threads at once. Keeps digests, not tokens.
class BearerTokens {
 public:
  /// One token a line; blank lines and lines that begin with '#' do not count. kInvalidArgument for
  /// a text without tokens or a token with characters that a header cannot carry.
  static core::Result<BearerTokens> Parse(std::string_view text);

  /// Whether the value of an Authorization header is `Bearer TOKEN` with one of the tokens. The
  /// time it takes tells nothing about them but their number.
  bool Allows(std::optional<std::string_view> authorization) const;

 private:
  std::vector<core::Sha256Digest> digests_;
};

}  // namespace kdray::server
