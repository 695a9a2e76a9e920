// SPDX-License-Identifier: Apache-2.0
// The interface of an object store (S3): what the library needs of it, without HTTP. The server has
// the adaptor (server/s3_store.h), tests a store in memory. core/store/retrying_store.h repeats
// what fails; core/store/shared_store.h says which objects there are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"

namespace kdray::core {

/// Error::field of an error that says: the store does not answer now, so nothing is known.
inline constexpr std::string_view kStoreIsAway = "store";
inline Error StoreIsAway(std::string message) {
  return Error{.code = ErrorCode::kIo, .message = std::move(message), .field = kStoreIsAway};
}
inline bool IsStoreAway(const Error& error) { return error.field == kStoreIsAway; }

struct ObjectInfo {
  std::string key;
  std::uint64_t bytes = 0;
  std::int64_t modified_ms = 0;  ///< since 1970, by the store's clock
};

struct ObjectPage {
  std::vector<ObjectInfo> objects;  ///< by ascending key
  bool has_more = false;            ///< after the last one
};

/// Whether Put and FinishParts replace an object of that key.
enum class PutMode : std::uint8_t {
  kReplace,
  /// Only if the store has conditional writes; it may replace otherwise. So only for objects whose
  /// contents follow from their key.
  kKeep,
};

/// Objects by key. Keys have the characters a-z, 0-9, '-' and '/'. Reads see all finished writes,
/// as S3 guarantees since 2020. Every call may be repeated with the same effect. A call that failed
/// may still take effect, even after a later one. Bodies are in memory, so that callers choose the
/// pieces. Safe from many threads at once.
///
/// Errors of every call: StoreIsAway if the store cannot be reached, does not answer in time, or is
/// busy; kCorrupt if the answer's length or checksum is wrong; kStoreFull if the store refuses for
/// good (no such bucket, no permission, a quota); kCancelled, kDeadlineExceeded by `cancel`, within
/// 250 ms. Messages name no addresses and no credentials.
class ObjectStore {
 public:
  virtual ~ObjectStore() = default;

  /// Milliseconds since 1970 by the store's clock, a quarter of an hour off at most: this machine's
  /// clock may be off by more. Asks nothing of the store.
  virtual std::int64_t NowMs() const = 0;

  /// At most `limit` (1 to 1000) objects whose keys begin with `prefix` and are greater than
  /// `after`, which may be empty.
  virtual Result<ObjectPage> List(std::string_view prefix, std::string_view after,
                                  std::size_t limit, const CancelToken& cancel) = 0;
  /// kNotFound.
  virtual Result<ObjectInfo> Head(std::string_view key, const CancelToken& cancel) = 0;
  /// Fills all of `out`, which is not empty, with the object's bytes from `offset`. kNotFound;
  /// kCorrupt if the object ends earlier.
  virtual Status Get(std::string_view key, std::uint64_t offset, std::span<std::byte> out,
                     const CancelToken& cancel) = 0;
  /// The object is durable when it returns. The store checks the SHA-256 of the bytes.
  virtual Status Put(std::string_view key, std::span<const std::byte> bytes, PutMode mode,
                     const CancelToken& cancel) = 0;
  /// An object that does not exist is success.
  virtual Status Delete(std::string_view key, const CancelToken& cancel) = 0;

  // An object in parts, each of at least kLeastPartBytes except the last one, at most kMostParts.
  static constexpr std::uint64_t kLeastPartBytes = std::uint64_t{5} << 20;
  static constexpr std::uint64_t kMostParts = 10'000;

  /// The name of the new upload.
  virtual Result<std::string> BeginParts(std::string_view key, const CancelToken& cancel) = 0;
  /// Part `number`, from 1. Returns its tag for FinishParts.
  virtual Result<std::string> PutPart(std::string_view key, std::string_view upload, int number,
                                      std::span<const std::byte> bytes,
                                      const CancelToken& cancel) = 0;
  /// The object is durable when it returns.
  virtual Status FinishParts(std::string_view key, std::string_view upload,
                             std::span<const std::string> tags, PutMode mode,
                             const CancelToken& cancel) = 0;
  /// Gives the space of the parts back.
  virtual Status AbortParts(std::string_view key, std::string_view upload,
                            const CancelToken& cancel) = 0;
};

}  // namespace kdray::core
