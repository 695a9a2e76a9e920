// SPDX-License-Identifier: Apache-2.0
#include "core/store/checked_file.h"

#include <array>
#include <cassert>
#include <cstring>
#include <utility>

namespace kdray::core {
namespace {

constexpr std::uint32_t kByteOrderMark = 0x01020304;
constexpr std::size_t kBufferBytes = 64 * 1024;

struct Header {
  std::array<char, 8> magic{};
  std::uint32_t version = 0;
  std::uint32_t byte_order = 0;
  friend bool operator==(const Header&, const Header&) = default;
};
static_assert(sizeof(Header) == 16);

struct Footer {
  std::uint64_t payload_bytes = 0;
  Sha256Digest digest;
};
static_assert(sizeof(Footer) == 40);

Header HeaderOf(const FileKind& kind) {
  Header header;
  assert(kind.magic.size() == header.magic.size());
  std::copy(kind.magic.begin(), kind.magic.end(), header.magic.begin());
  header.version = kind.version;
  header.byte_order = kByteOrderMark;
  return header;
}

template <class T>
std::span<const std::byte> BytesOf(const T& value) {
  return std::as_bytes(std::span(&value, 1));
}

Error Corrupt(const char* what) {
  return Error{ErrorCode::kCorrupt, std::string("a stored file ") + what};
}

}  // namespace

CheckedWriter::CheckedWriter(NewBlob blob, const FileKind& kind, CancelToken cancel)
    : blob_(std::move(blob)), cancel_(std::move(cancel)), buffer_(kBufferBytes) {
  Begin(kind);
}

CheckedWriter::CheckedWriter(const FileKind& kind) { Begin(kind); }

void CheckedWriter::Begin(const FileKind& kind) {
  PutBytes(BytesOf(HeaderOf(kind)));
  payload_bytes_ = 0;
}

Status CheckedWriter::Emit(std::span<const std::byte> bytes) {
  if (blob_) return blob_->Append(bytes);
  memory_.insert(memory_.end(), bytes.begin(), bytes.end());
  return {};
}

void CheckedWriter::PutBytes(std::span<const std::byte> bytes) {
  payload_bytes_ += bytes.size();
  if (bytes.size() > buffer_.size() - buffered_) Flush();
  if (bytes.size() > buffer_.size()) {
    Write(bytes);
    return;
  }
  std::copy(bytes.begin(), bytes.end(), buffer_.begin() + static_cast<std::ptrdiff_t>(buffered_));
  buffered_ += bytes.size();
}

void CheckedWriter::Flush() {
  Write(std::span<const std::byte>(buffer_).first(buffered_));
  buffered_ = 0;
}

void CheckedWriter::Write(std::span<const std::byte> bytes) {
  while (status_.ok() && !bytes.empty()) {
    const auto piece = bytes.first(std::min(bytes.size(), kFilePieceBytes));
    bytes = bytes.subspan(piece.size());
    hash_.Update(piece);
    status_ = Emit(piece);
    since_look_ += piece.size();
    if (since_look_ < kFilePieceBytes) continue;
    since_look_ = 0;
    if (status_.ok() && cancel_.ShouldStop()) status_ = cancel_.ToError();
  }
}

void CheckedWriter::End() {
  Footer footer;
  footer.payload_bytes = payload_bytes_;
  PutBytes(BytesOf(footer.payload_bytes));
  Flush();
  footer.digest = hash_.Finish();
  if (status_.ok()) status_ = Emit(BytesOf(footer.digest));
}

Result<NewBlob> CheckedWriter::Finish() && {
  assert(blob_);
  End();
  if (status_.ok()) status_ = blob_->Sync();
  if (!status_.ok()) return std::move(status_).error();
  return *std::move(blob_);
}

std::vector<std::byte> CheckedWriter::FinishInMemory() && {
  assert(!blob_);
  End();
  return std::move(memory_);
}

CheckedReader::CheckedReader(std::unique_ptr<ReadableFile> file, const FileKind& kind,
                             CancelToken cancel)
    : file_(std::move(file)), cancel_(std::move(cancel)), version_(kind.version) {
  const std::uint64_t size = file_->size();
  if (size < sizeof(Header) + sizeof(Footer)) {
    status_ = Corrupt("is too short");
    return;
  }
  payload_bytes_ = size - sizeof(Header) - sizeof(Footer);
  remaining_ = sizeof(Header);
  Header header;
  GetBytes(std::as_writable_bytes(std::span(&header, 1)));
  if (header.version >= kind.oldest && header.version < kind.version) version_ = header.version;
  Header expected = HeaderOf(kind);
  expected.version = version_;
  if (status_.ok() && header != expected) status_ = Corrupt("has another format or version");
  remaining_ = payload_bytes_;
}

void CheckedReader::GetBytes(std::span<std::byte> out) {
  if (status_.ok() && out.size() > remaining_) status_ = Corrupt("is shorter than it says");
  if (status_.ok() && Fill(out)) {
    remaining_ -= out.size();
    return;
  }
  std::fill(out.begin(), out.end(), std::byte{0});
}

// Small pieces come out of a buffer, large ones straight from the file.
bool CheckedReader::Fill(std::span<std::byte> out) {
  const std::size_t buffered = std::min(out.size(), buffer_.size() - buffer_next_);
  std::copy_n(buffer_.begin() + static_cast<std::ptrdiff_t>(buffer_next_), buffered, out.begin());
  buffer_next_ += buffered;
  out = out.subspan(buffered);
  if (out.empty()) return true;

  const std::uint64_t end_of_payload = sizeof(Header) + payload_bytes_;
  if (out.size() >= kBufferBytes) {
    for (; !out.empty(); out = out.subspan(std::min(out.size(), kFilePieceBytes))) {
      if (!Read(out.first(std::min(out.size(), kFilePieceBytes)))) return false;
    }
    return true;
  }
  buffer_.resize(
      static_cast<std::size_t>(std::min<std::uint64_t>(kBufferBytes, end_of_payload - offset_)));
  buffer_next_ = 0;
  if (!Read(buffer_)) return false;
  std::copy_n(buffer_.begin(), out.size(), out.begin());
  buffer_next_ = out.size();
  return true;
}

// The next bytes of the file, at most a piece.
bool CheckedReader::Read(std::span<std::byte> out) {
  if (offset_ >= next_look_) {
    next_look_ = offset_ + kFilePieceBytes;
    if (cancel_.ShouldStop()) status_ = cancel_.ToError();
  }
  if (status_.ok()) status_ = file_->ReadAt(offset_, out);
  if (!status_.ok()) return false;
  hash_.Update(out);
  offset_ += out.size();
  return true;
}

void CheckedReader::Fail() {
  if (status_.ok()) status_ = Corrupt("contains an invalid value");
}

void CheckedReader::SkipRest() {
  std::array<std::byte, 4096> piece;
  while (status_.ok() && remaining_ != 0) {
    const std::uint64_t bytes = std::min<std::uint64_t>(remaining_, piece.size());
    GetBytes(std::span(piece).first(static_cast<std::size_t>(bytes)));
  }
}

Status CheckedReader::Finish() {
  if (status_.ok() && remaining_ != 0) status_ = Corrupt("is longer than it says");
  if (!status_.ok()) return status_;
  Footer footer;
  std::array<std::byte, sizeof(Footer)> bytes;
  status_ = file_->ReadAt(sizeof(Header) + payload_bytes_, bytes);
  if (!status_.ok()) return status_;
  std::memcpy(&footer.payload_bytes, bytes.data(), sizeof footer.payload_bytes);
  std::memcpy(&footer.digest, bytes.data() + sizeof footer.payload_bytes, sizeof footer.digest);
  hash_.Update(BytesOf(footer.payload_bytes));
  if (footer.payload_bytes != payload_bytes_ || hash_.Finish() != footer.digest) {
    status_ = Corrupt("fails its check");
  }
  return status_;
}

}  // namespace kdray::core
