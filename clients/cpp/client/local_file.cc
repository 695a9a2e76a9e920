#include "clients/cpp/client/local_file.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <vector>

#include "clients/cpp/client/error.h"

namespace kdray::client {
namespace {

[[noreturn]] void Fail(const std::string& path, const std::string& why) {
  throw LocalFileError(path + ": " + why);
}

}  // namespace

LocalFile::LocalFile(std::string path) : path_(std::move(path)) {
  // O_NONBLOCK: otherwise opening a named pipe would wait for a writer before we can reject it.
  descriptor_ = open(path_.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor_ < 0) Fail(path_, std::strerror(errno));
  struct stat status {};
  const bool is_file = fstat(descriptor_, &status) == 0 && S_ISREG(status.st_mode);
  if (!is_file) {
    close(descriptor_);
    Fail(path_, "not a regular file");
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
}

LocalFile::~LocalFile() { close(descriptor_); }

void LocalFile::Read(std::uint64_t offset, std::span<char> out) const {
  while (!out.empty()) {
    const ssize_t got = pread(descriptor_, out.data(), out.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) Fail(path_, std::strerror(errno));
    if (got == 0) Fail(path_, "the file became shorter while it was read");
    out = out.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
  }
}

std::string LocalFile::Sha256() const {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(),
                                                                        &EVP_MD_CTX_free);
  std::array<unsigned char, 32> digest{};
  bool ok = context && EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) == 1;
  std::vector<char> chunk(1 << 20);
  for (std::uint64_t offset = 0; ok && offset < size_; offset += chunk.size()) {
    chunk.resize(std::min<std::uint64_t>(chunk.size(), size_ - offset));
    Read(offset, chunk);
    ok = EVP_DigestUpdate(context.get(), chunk.data(), chunk.size()) == 1;
  }
  ok = ok && EVP_DigestFinal_ex(context.get(), digest.data(), nullptr) == 1;
  if (!ok) throw std::runtime_error("SHA-256 is not available from this machine's OpenSSL");
  constexpr char kHex[] = "0123456789abcdef";
  std::string text;
  for (const unsigned char byte : digest) text += {kHex[byte >> 4], kHex[byte & 15]};
  return text;
}

}  // namespace kdray::client
