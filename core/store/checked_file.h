// SPDX-License-Identifier: Apache-2.0
// Files of our own formats, checked as a whole when they are read:
//   8 bytes magic, 4 bytes version, 4 bytes byte-order mark | payload | 8 bytes payload length,
//   32 bytes SHA-256 of everything before.
// Numbers and arrays stand in the payload as they lie in memory: a stored tree is read straight
// into its vectors, and a machine of another byte order refuses the file and makes its own.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/hash.h"
#include "core/base/result.h"
#include "core/store/blob_store.h"

namespace kdray::core {

/// What kind of file, and which version of its payload.
struct FileKind {
  std::string_view magic;          ///< exactly 8 characters
  std::uint32_t version;           ///< of what is written
  std::uint32_t oldest = version;  ///< that is still read
};

/// Types whose bytes may stand in a file: no pointers, no padding that would make equal values
/// differ, and every pattern of bytes a value. Floating point has all but the last by nature;
/// structs of numbers say so by specialising this.
template <class T>
inline constexpr bool kStorable = std::is_arithmetic_v<T> && !std::is_same_v<T, bool>;

/// Bytes that are read or written between two looks at a cancel token. Hashing them and passing
/// them to the system takes some milliseconds.
inline constexpr std::size_t kFilePieceBytes = std::size_t{1} << 20;

/// Writes one file. Errors stick: the first one comes back from Finish, kCancelled and
/// kDeadlineExceeded among them; after an error the temporary file is removed. Looks at `cancel`
/// after each kFilePieceBytes, so a smaller file is finished in any case. One thread at a time.
class CheckedWriter {
 public:
  CheckedWriter(NewBlob blob, const FileKind& kind, CancelToken cancel = {});
  /// Writes the file to memory; for small ones.
  explicit CheckedWriter(const FileKind& kind);

  template <class T>
  void Put(const T& value) {
    static_assert(kStorable<T> && std::is_trivially_copyable_v<T>);
    PutBytes(std::as_bytes(std::span(&value, 1)));
  }
  /// The count, then the elements.
  template <class T>
  void PutArray(std::span<const T> values) {
    static_assert(kStorable<T> && std::is_trivially_copyable_v<T>);
    Put(static_cast<std::uint64_t>(values.size()));
    PutBytes(std::as_bytes(values));
  }
  void PutBytes(std::span<const std::byte> bytes);

  /// Everything is on stable storage under its temporary name; Commit of the result names it.
  Result<NewBlob> Finish() &&;
  /// The bytes of a file in memory.
  std::vector<std::byte> FinishInMemory() &&;

 private:
  void Begin(const FileKind& kind);
  void End();
  Status Emit(std::span<const std::byte> bytes);
  void Flush();
  void Write(std::span<const std::byte> bytes);

  std::optional<NewBlob> blob_;  // nullopt: in memory
  std::vector<std::byte> memory_;
  CancelToken cancel_;
  Sha256 hash_;
  std::vector<std::byte> buffer_;  // small pieces on their way
  std::size_t buffered_ = 0;       // bytes of them
  std::size_t since_look_ = 0;     // bytes written since the last look at cancel_
  std::uint64_t payload_bytes_ = 0;
  Status status_;
};

/// Reads one file from front to back. Errors stick, and what is read after one is zero or empty; a
/// value counts only once Finish has said that the whole file is sound. Memory is allocated for
/// what the file's size can hold. Looks at `cancel` before each kFilePieceBytes. One thread at a
/// time.
class CheckedReader {
 public:
  CheckedReader(std::unique_ptr<ReadableFile> file, const FileKind& kind, CancelToken cancel = {});

  template <class T>
  T Get() {
    static_assert(kStorable<T> && std::is_trivially_copyable_v<T>);
    T value{};
    GetBytes(std::as_writable_bytes(std::span(&value, 1)));
    return value;
  }
  /// Like Get, for numbers of which only those below `end` make sense.
  template <class T>
  T GetBelow(T end) {
    const T value = Get<T>();
    if (value < end) return value;
    Fail();
    return T{};
  }
  template <class T>
  std::vector<T> GetArray() {
    std::vector<T> values;
    GetArray(&values);
    return values;
  }
  /// The same into a vector with an allocator of its own.
  template <class T, class Allocator>
  void GetArray(std::vector<T, Allocator>* values) {
    static_assert(kStorable<T> && std::is_trivially_copyable_v<T>);
    values->clear();
    const std::uint64_t count = Get<std::uint64_t>();
    if (count > remaining_ / sizeof(T)) {
      Fail();
      return;
    }
    // In pieces, because filling new memory with zeros takes a time too.
    values->reserve(static_cast<std::size_t>(count));
    while (status_.ok() && values->size() < count) {
      const std::size_t begin = values->size();
      values->resize(
          begin + std::min(static_cast<std::size_t>(count) - begin, kFilePieceBytes / sizeof(T)));
      GetBytes(std::as_writable_bytes(std::span(*values).subspan(begin)));
    }
    if (!status_.ok()) values->clear();
  }
  void GetBytes(std::span<std::byte> out);
  /// Passes over the rest of the payload, which is checked like all of it.
  void SkipRest();
  /// Of the file, from `oldest` to `version` of its kind; `version` when the header is wrong.
  std::uint32_t version() const { return version_; }
  /// The reader of a payload found something that cannot be.
  void Fail();

  /// kCorrupt when anything was wrong: magic, version, byte order, length, contents, or bytes left
  /// over; kIo when the disk refused; kCancelled and kDeadlineExceeded, which say nothing about the
  /// file.
  Status Finish();

 private:
  bool Fill(std::span<std::byte> out);
  bool Read(std::span<std::byte> out);

  std::unique_ptr<ReadableFile> file_;
  CancelToken cancel_;
  std::uint64_t next_look_ = 0;  // at cancel_: the offset_ from which on it is due
  Sha256 hash_;
  std::vector<std::byte> buffer_;
  std::size_t buffer_next_ = 0;  // first byte of buffer_ not handed out yet
  std::uint64_t offset_ = 0;     // in the file, after buffer_
  std::uint64_t remaining_ = 0;  // payload not handed out yet
  std::uint64_t payload_bytes_ = 0;
  std::uint32_t version_ = 0;
  Status status_;
};

}  // namespace kdray::core
