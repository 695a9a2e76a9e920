// SPDX-License-Identifier: Apache-2.0
// SHA-256 of mesh bytes and stored files (OpenSSL's implementation, which uses the processor's SHA
// instructions).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace kdray::core {

/// 32 bytes, compared as bytes.
struct Sha256Digest {
  std::array<std::uint8_t, 32> bytes{};

  /// 64 lower-case hexadecimal digits.
  std::string ToHex() const;
  friend bool operator==(const Sha256Digest&, const Sha256Digest&) = default;
  friend auto operator<=>(const Sha256Digest&, const Sha256Digest&) = default;
};

/// Returns true and sets *digest for exactly 64 lower-case hexadecimal digits.
bool ParseSha256Hex(std::string_view hex, Sha256Digest* digest);

/// Incremental hashing, to hash an upload while it arrives. For one thread at a time.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void Update(std::span<const std::byte> bytes);
  /// The digest of all bytes so far; call once.
  Sha256Digest Finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

Sha256Digest HashBytes(std::span<const std::byte> bytes);

}  // namespace kdray::core
