// SPDX-License-Identifier: Apache-2.0
// Bytes to send: a file, standard input, memory, or pieces of these in a row.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace kdray::client {

/// Called during long work on a payload with the bytes done so far.
using ByteProgress = std::function<void(std::uint64_t done)>;

/// Immutable; copies are cheap and share the file or the memory. Safe to read from several threads.
class Payload {
 public:
  /// The bytes of a file, read when they are needed. The file is opened once, so every reader sees
  /// the same file even if it is replaced meanwhile. Throws LocalFileError if it cannot be opened
  /// or is not a regular file.
  static Payload OfFile(const std::string& path);

  /// Everything on standard input. A pipe is copied to a temporary file without a name (in TMPDIR,
  /// else /tmp) first, so its size is bounded by the disk and not by memory. `on_read` hears of the
  /// copying. Throws LocalFileError if it cannot be read or stored.
  static Payload OfStandardInput(const ByteProgress& on_read = {});

  /// `name` appears in errors.
  static Payload OfBytes(std::string name, std::string bytes);

  /// These payloads one after another, under the name of the first that is not empty.
  static Payload Join(const std::vector<Payload>& payloads);

  /// `size` bytes from `offset`. @pre they lie inside.
  Payload Part(std::uint64_t offset, std::uint64_t size) const;

  const std::string& name() const { return name_; }
  std::uint64_t size() const { return size_; }

  /// Fills `out` from `offset`. Throws LocalFileError on a read error, or if a file ends earlier
  /// (it was truncated). @pre the bytes lie inside.
  void Read(std::uint64_t offset, std::span<char> out) const;

  /// SHA-256 of all bytes, 64 lower-case hex digits. Reads all of them.
  std::string Sha256(const ByteProgress& on_hashed = {}) const;

 private:
  class Source;
  class FileSource;
  class MemorySource;
  struct Piece {
    std::shared_ptr<const Source> source;
    std::uint64_t begin = 0, size = 0;
  };

  Payload(std::string name, std::vector<Piece> pieces);

  std::string name_;
  std::vector<Piece> pieces_;
  std::uint64_t size_ = 0;
};

/// The value of Content-Digest (RFC 9530) for bytes with this SHA-256, 64 hexadecimal digits.
/// Throws UsageError if `sha256` is invalid.
std::string ContentDigest(const std::string& sha256);

}  // namespace kdray::client
