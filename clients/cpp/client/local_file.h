// A local file to send. It is opened once, so every reader sees the same file even if it is
// replaced meanwhile.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace kdray::client {

class LocalFile {
 public:
  /// Throws LocalFileError when it cannot be opened or is not a regular file.
  explicit LocalFile(std::string path);
  ~LocalFile();
  LocalFile(const LocalFile&) = delete;
  LocalFile& operator=(const LocalFile&) = delete;

  const std::string& path() const { return path_; }
  std::uint64_t size() const { return size_; }

  /// Fills `out` from `offset`. Throws LocalFileError on a read error, or if the file ends earlier
  /// (it was truncated).
  void Read(std::uint64_t offset, std::span<char> out) const;

  /// SHA-256 of the whole file, 64 lower-case hex digits. Reads the whole file.
  std::string Sha256() const;

 private:
  std::string path_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace kdray::client
