// SPDX-License-Identifier: Apache-2.0
#include "core/store/counting_store.h"

#include <algorithm>

namespace kdray::core {

template <class Call>
auto CountingStore::Count(StoreOperation operation, Bytes bytes, const Call& call)
    -> decltype(call()) {
  const auto start = std::chrono::steady_clock::now();
  auto answer = call();
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const bool is_answered = answer.ok() || answer.error().code == ErrorCode::kNotFound;
  if (!is_answered && (answer.error().code == ErrorCode::kCancelled ||
                       answer.error().code == ErrorCode::kDeadlineExceeded)) {
    return answer;
  }
  const auto& ends = StoreCounts::kMostSeconds;
  const auto time_class =
      static_cast<std::size_t>(std::lower_bound(ends.begin(), ends.end(), seconds) - ends.begin());
  const std::lock_guard lock(mutex_);
  StoreCounts::Requests& requests = counts_.requests[static_cast<std::size_t>(operation)];
  ++(is_answered ? requests.answered : requests.failed);
  if (answer.ok()) {
    counts_.sent_bytes += bytes.sent;
    counts_.received_bytes += bytes.received;
  }
  ++counts_.by_time[time_class];
  counts_.seconds += seconds;
  return answer;
}

StoreCounts CountingStore::counts() const {
  const std::lock_guard lock(mutex_);
  return counts_;
}

Result<ObjectPage> CountingStore::List(std::string_view prefix, std::string_view after,
                                       std::size_t limit, const CancelToken& cancel) {
  return Count(StoreOperation::kList, {},
               [&] { return store_->List(prefix, after, limit, cancel); });
}

Result<ObjectInfo> CountingStore::Head(std::string_view key, const CancelToken& cancel) {
  return Count(StoreOperation::kHead, {}, [&] { return store_->Head(key, cancel); });
}

Status CountingStore::Get(std::string_view key, std::uint64_t offset, std::span<std::byte> out,
                          const CancelToken& cancel) {
  return Count(StoreOperation::kGet, {.received = out.size()},
               [&] { return store_->Get(key, offset, out, cancel); });
}

Status CountingStore::Put(std::string_view key, std::span<const std::byte> bytes, PutMode mode,
                          const CancelToken& cancel) {
  return Count(StoreOperation::kPut, {.sent = bytes.size()},
               [&] { return store_->Put(key, bytes, mode, cancel); });
}

Status CountingStore::Delete(std::string_view key, const CancelToken& cancel) {
  return Count(StoreOperation::kDelete, {}, [&] { return store_->Delete(key, cancel); });
}

Result<std::string> CountingStore::BeginParts(std::string_view key, const CancelToken& cancel) {
  return Count(StoreOperation::kPut, {}, [&] { return store_->BeginParts(key, cancel); });
}

Result<std::string> CountingStore::PutPart(std::string_view key, std::string_view upload,
                                           int number, std::span<const std::byte> bytes,
                                           const CancelToken& cancel) {
  return Count(StoreOperation::kPut, {.sent = bytes.size()},
               [&] { return store_->PutPart(key, upload, number, bytes, cancel); });
}

Status CountingStore::FinishParts(std::string_view key, std::string_view upload,
                                  std::span<const std::string> tags, PutMode mode,
                                  const CancelToken& cancel) {
  return Count(StoreOperation::kPut, {},
               [&] { return store_->FinishParts(key, upload, tags, mode, cancel); });
}

Status CountingStore::AbortParts(std::string_view key, std::string_view upload,
                                 const CancelToken& cancel) {
  return Count(StoreOperation::kDelete, {},
               [&] { return store_->AbortParts(key, upload, cancel); });
}

}  // namespace kdray::core
