// SPDX-License-Identifier: Apache-2.0
// An object store that counts the requests to the store under it, and measures their time. For
// metrics: RetryingStore is above it, so each attempt counts.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <string>
#include <string_view>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/store/object_store.h"

namespace kdray::core {

/// Requests for parts of an object count as kPut, and those that give parts up as kDelete.
enum class StoreOperation : std::uint8_t { kList, kHead, kGet, kPut, kDelete };
inline constexpr std::size_t kStoreOperations = 5;

struct StoreCounts {
  /// Upper ends of the classes of times, in seconds; the last class has none.
  static constexpr std::array kMostSeconds = {0.005, 0.025, 0.1, 0.5, 2.5};

  struct Requests {
    std::uint64_t answered = 0;  ///< "there is no such object" is an answer
    std::uint64_t failed = 0;    ///< no answer, a refusal, or an altered answer
  };
  std::array<Requests, kStoreOperations> requests{};  ///< by StoreOperation; no cancelled ones
  std::uint64_t sent_bytes = 0;                       ///< of objects, in answered requests
  std::uint64_t received_bytes = 0;
  std::array<std::uint64_t, kMostSeconds.size() + 1> by_time{};  ///< requests in each class
  double seconds = 0;                                            ///< the sum of their times
};

/// Safe from many threads at once.
class CountingStore final : public ObjectStore {
 public:
  /// `store` must outlive this.
  explicit CountingStore(ObjectStore* store) : store_(store) {}

  StoreCounts counts() const;

  std::int64_t NowMs() const override { return store_->NowMs(); }
  Result<ObjectPage> List(std::string_view prefix, std::string_view after, std::size_t limit,
                          const CancelToken& cancel) override;
  Result<ObjectInfo> Head(std::string_view key, const CancelToken& cancel) override;
  Status Get(std::string_view key, std::uint64_t offset, std::span<std::byte> out,
             const CancelToken& cancel) override;
  Status Put(std::string_view key, std::span<const std::byte> bytes, PutMode mode,
             const CancelToken& cancel) override;
  Status Delete(std::string_view key, const CancelToken& cancel) override;
  Result<std::string> BeginParts(std::string_view key, const CancelToken& cancel) override;
  Result<std::string> PutPart(std::string_view key, std::string_view upload, int number,
                              std::span<const std::byte> bytes, const CancelToken& cancel) override;
  Status FinishParts(std::string_view key, std::string_view upload,
                     std::span<const std::string> tags, PutMode mode,
                     const CancelToken& cancel) override;
  Status AbortParts(std::string_view key, std::string_view upload,
                    const CancelToken& cancel) override;

 private:
  struct Bytes {
    std::size_t sent = 0, received = 0;
  };
  template <class Call>
  auto Count(StoreOperation operation, Bytes bytes, const Call& call) -> decltype(call());

  ObjectStore* const store_;
  mutable std::mutex mutex_;
  StoreCounts counts_;
};

}  // namespace kdray::core
