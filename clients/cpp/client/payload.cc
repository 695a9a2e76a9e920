// SPDX-License-Identifier: Apache-2.0
#include "kdray/payload.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <utility>
#include <vector>

#include "kdray/error.h"
#include "kdray/problem.h"

namespace kdray::client {
namespace {

constexpr std::size_t kChunkBytes = std::size_t{1} << 20;

[[noreturn]] void Fail(const std::string& name, const std::string& why) {
  throw LocalFileError(name + ": " + why);
}

// Closes a file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&&) = delete;
  ~Descriptor() {
    if (number_ >= 0) close(number_);
  }

  int operator*() const { return number_; }

 private:
  int number_;
};

// A file without a name, which ends with its descriptor.
Descriptor TemporaryFile() {
  const char* const chosen = std::getenv("TMPDIR");
  const std::string folder = chosen != nullptr && *chosen != '\0' ? chosen : "/tmp";
  Descriptor unnamed(open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600));
  if (*unnamed >= 0) return unnamed;
  // Some file systems do not know O_TMPFILE.
  std::string path = folder + "/kdray-XXXXXX";
  Descriptor named(mkostemp(path.data(), O_CLOEXEC));
  if (*named < 0) Fail(folder, std::string("no temporary file: ") + std::strerror(errno));
  unlink(path.c_str());
  return named;
}

void WriteAll(int descriptor, std::span<const char> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(descriptor, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) Fail("temporary file", std::strerror(errno));
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

}  // namespace

class Payload::Source {
 public:
  Source() = default;
  virtual ~Source() = default;
  Source(const Source&) = delete;
  Source& operator=(const Source&) = delete;
  virtual void Read(std::uint64_t offset, std::span<char> out) const = 0;
};

class Payload::FileSource : public Source {
 public:
  FileSource(std::string name, Descriptor descriptor)
      : name_(std::move(name)), descriptor_(std::move(descriptor)) {}

  void Read(std::uint64_t offset, std::span<char> out) const override {
    while (!out.empty()) {
      const ssize_t got = pread(*descriptor_, out.data(), out.size(), static_cast<off_t>(offset));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) Fail(name_, std::strerror(errno));
      if (got == 0) Fail(name_, "the file became shorter while it was read");
      out = out.subspan(static_cast<std::size_t>(got));
      offset += static_cast<std::uint64_t>(got);
    }
  }

 private:
  std::string name_;
  Descriptor descriptor_;
};

class Payload::MemorySource : public Source {
 public:
  explicit MemorySource(std::string bytes) : bytes_(std::move(bytes)) {}

  void Read(std::uint64_t offset, std::span<char> out) const override {
    std::memcpy(out.data(), bytes_.data() + offset, out.size());
  }

 private:
  std::string bytes_;
};

Payload::Payload(std::string name, std::vector<Piece> pieces)
    : name_(std::move(name)), pieces_(std::move(pieces)) {
  for (const Piece& piece : pieces_) size_ += piece.size;
}

Payload Payload::OfFile(const std::string& path) {
  // O_NONBLOCK: otherwise opening a named pipe would wait for a writer before we can reject it.
  Descriptor descriptor(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (*descriptor < 0) Fail(path, std::strerror(errno));
  struct stat status {};
  if (fstat(*descriptor, &status) != 0 || !S_ISREG(status.st_mode)) {
    Fail(path, "not a regular file");
  }
  const auto size = static_cast<std::uint64_t>(status.st_size);
  return {path, {{std::make_shared<FileSource>(path, std::move(descriptor)), 0, size}}};
}

Payload Payload::OfStandardInput(const ByteProgress& on_read) {
  const std::string name = "standard input";
  struct stat status {};
  if (fstat(STDIN_FILENO, &status) == 0 && S_ISREG(status.st_mode)) {
    const off_t begin = std::max<off_t>(lseek(STDIN_FILENO, 0, SEEK_CUR), 0);
    Descriptor copy(fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 0));
    if (*copy < 0) Fail(name, std::strerror(errno));
    const auto size = static_cast<std::uint64_t>(std::max<off_t>(status.st_size - begin, 0));
    return {name,
            {{std::make_shared<FileSource>(name, std::move(copy)),
              static_cast<std::uint64_t>(begin), size}}};
  }
  Descriptor spool = TemporaryFile();
  std::uint64_t size = 0;
  std::vector<char> chunk(kChunkBytes);
  for (;;) {
    const ssize_t got = read(STDIN_FILENO, chunk.data(), chunk.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) Fail(name, std::strerror(errno));
    if (got == 0) break;
    WriteAll(*spool, std::span<const char>(chunk).first(static_cast<std::size_t>(got)));
    size += static_cast<std::uint64_t>(got);
    if (on_read) on_read(size);
  }
  return {name, {{std::make_shared<FileSource>(name, std::move(spool)), 0, size}}};
}

Payload Payload::OfBytes(std::string name, std::string bytes) {
  const std::uint64_t size = bytes.size();
  return {std::move(name), {{std::make_shared<MemorySource>(std::move(bytes)), 0, size}}};
}

Payload Payload::Join(const std::vector<Payload>& payloads) {
  std::string name;
  std::vector<Piece> pieces;
  for (const Payload& payload : payloads) {
    if (name.empty()) name = payload.name_;
    pieces.insert(pieces.end(), payload.pieces_.begin(), payload.pieces_.end());
  }
  return {std::move(name), std::move(pieces)};
}

Payload Payload::Part(std::uint64_t offset, std::uint64_t size) const {
  std::vector<Piece> pieces;
  for (const Piece& piece : pieces_) {
    if (offset >= piece.size) {
      offset -= piece.size;
      continue;
    }
    const std::uint64_t taken = std::min(size, piece.size - offset);
    if (taken > 0) pieces.push_back({piece.source, piece.begin + offset, taken});
    offset = 0;
    size -= taken;
  }
  return {name_, std::move(pieces)};
}

void Payload::Read(std::uint64_t offset, std::span<char> out) const {
  for (const Piece& piece : pieces_) {
    if (out.empty()) return;
    if (offset >= piece.size) {
      offset -= piece.size;
      continue;
    }
    const std::size_t taken = std::min<std::uint64_t>(out.size(), piece.size - offset);
    piece.source->Read(piece.begin + offset, out.first(taken));
    out = out.subspan(taken);
    offset = 0;
  }
}

std::string Payload::Sha256(const ByteProgress& on_hashed) const {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(),
                                                                        &EVP_MD_CTX_free);
  std::array<unsigned char, 32> digest{};
  bool ok = context && EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) == 1;
  std::vector<char> chunk(kChunkBytes);
  for (std::uint64_t offset = 0; ok && offset < size_; offset += chunk.size()) {
    chunk.resize(std::min<std::uint64_t>(chunk.size(), size_ - offset));
    Read(offset, chunk);
    ok = EVP_DigestUpdate(context.get(), chunk.data(), chunk.size()) == 1;
    if (on_hashed) on_hashed(offset + chunk.size());
  }
  ok = ok && EVP_DigestFinal_ex(context.get(), digest.data(), nullptr) == 1;
  if (!ok) throw std::runtime_error("SHA-256 is not available from this machine's OpenSSL");
  constexpr char kHex[] = "0123456789abcdef";
  std::string text;
  for (const unsigned char byte : digest) text += {kHex[byte >> 4], kHex[byte & 15]};
  return text;
}

std::string ContentDigest(const std::string& sha256) {
  std::array<unsigned char, 32> bytes{};
  bool valid = sha256.size() == 2 * bytes.size();
  for (std::size_t i = 0; valid && i < bytes.size(); ++i) {
    const char* const first = sha256.data() + 2 * i;
    const auto [end, error] = std::from_chars(first, first + 2, bytes[i], 16);
    valid = error == std::errc() && end == first + 2;
  }
  if (!valid) throw UsageError("'" + Printable(sha256) + "' is not a SHA-256 in hexadecimal");
  std::array<unsigned char, 45> text{};  // 44 characters, and a 0
  const int length = EVP_EncodeBlock(text.data(), bytes.data(), bytes.size());
  return "sha-256=:" + std::string(text.begin(), text.begin() + length) + ":";
}

}  // namespace kdray::client
