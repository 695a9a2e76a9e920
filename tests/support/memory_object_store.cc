// SPDX-License-Identifier: Apache-2.0
#include "tests/support/memory_object_store.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace kdray::test {
namespace {

using core::CancelToken;
using core::Error;
using core::ErrorCode;
using core::Result;
using core::Status;

Error NotThere() { return Error{ErrorCode::kNotFound, "no such object"}; }

}  // namespace

void MemoryObjectStore::set_faults(Faults faults) {
  const std::lock_guard lock(mutex_);
  faults_ = faults ? std::make_shared<Faults>(std::move(faults)) : nullptr;
}

void MemoryObjectStore::set_conditional_writes(bool has_them) {
  const std::lock_guard lock(mutex_);
  has_conditional_writes_ = has_them;
}

void MemoryObjectStore::DeliverLate(std::string_view part) {
  const std::lock_guard lock(mutex_);
  std::vector<Late> kept;
  for (Late& late : late_) {
    if (late.key.find(part) != std::string::npos) {
      late.write();
    } else {
      kept.push_back(std::move(late));
    }
  }
  late_ = std::move(kept);
}

std::vector<std::string> MemoryObjectStore::Keys(std::string_view prefix) const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> keys;
  for (const auto& [key, object] : objects_) {
    if (key.starts_with(prefix)) keys.push_back(key);
  }
  return keys;
}

std::vector<std::byte> MemoryObjectStore::Contents(const std::string& key) const {
  const std::lock_guard lock(mutex_);
  return objects_.at(key).bytes;
}

void MemoryObjectStore::SetContents(const std::string& key, std::vector<std::byte> contents) {
  const std::lock_guard lock(mutex_);
  objects_[key] = {std::move(contents), NowMs()};
}

void MemoryObjectStore::Erase(const std::string& key) {
  const std::lock_guard lock(mutex_);
  objects_.erase(key);
}

void MemoryObjectStore::Age(std::int64_t ms) {
  const std::lock_guard lock(mutex_);
  for (auto& [key, object] : objects_) object.modified_ms -= ms;
}

void MemoryObjectStore::SetClock(std::int64_t ahead_ms) { ahead_ms_ = ahead_ms; }

std::int64_t MemoryObjectStore::NowMs() const {
  return ahead_ms_ + std::chrono::duration_cast<std::chrono::milliseconds>(
                         std::chrono::system_clock::now().time_since_epoch())
                         .count();
}

std::uint64_t MemoryObjectStore::calls(Call call) const {
  const std::lock_guard lock(mutex_);
  const auto found = calls_.find(call);
  return found == calls_.end() ? 0 : found->second;
}

std::uint64_t MemoryObjectStore::calls() const {
  const std::lock_guard lock(mutex_);
  std::uint64_t sum = 0;
  for (const auto& [call, count] : calls_) sum += count;
  return sum;
}

std::size_t MemoryObjectStore::unfinished_uploads() const {
  const std::lock_guard lock(mutex_);
  return uploads_.size();
}

Result<MemoryObjectStore::Fault> MemoryObjectStore::Begin(Call call, std::string_view key,
                                                          const CancelToken& cancel) {
  if (cancel.ShouldStop()) return cancel.ToError();
  std::shared_ptr<Faults> faults;
  {
    const std::lock_guard lock(mutex_);
    ++calls_[call];
    faults = faults_;
  }
  const Fault fault = faults ? (*faults)(call, key) : Fault::kNone;
  if (fault == Fault::kAway) return core::StoreIsAway("the store does not answer");
  if (fault == Fault::kRefused) return Error{ErrorCode::kStoreFull, "the store refuses"};
  if (fault == Fault::kTruncated) return Error{ErrorCode::kCorrupt, "the answer is cut off"};
  return fault;
}

Status MemoryObjectStore::Write(Fault fault, std::string_view key, std::function<void()> write) {
  const std::lock_guard lock(mutex_);
  if (fault == Fault::kLate) {
    late_.push_back({std::string(key), std::move(write)});
  } else {
    write();
  }
  if (fault == Fault::kLate || fault == Fault::kLostAnswer) {
    return core::StoreIsAway("the answer was lost");
  }
  return {};
}

void MemoryObjectStore::PutLocked(const std::string& key, std::vector<std::byte> bytes,
                                  core::PutMode mode) {
  if (mode == core::PutMode::kKeep && has_conditional_writes_ && objects_.contains(key)) return;
  objects_[key] = {std::move(bytes), NowMs()};
}

Result<core::ObjectPage> MemoryObjectStore::List(std::string_view prefix, std::string_view after,
                                                 std::size_t limit, const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kList, prefix, cancel);
  if (!fault.ok()) return fault.error();
  if (*fault == Fault::kLostAnswer || *fault == Fault::kLate) {
    return core::StoreIsAway("the answer was lost");
  }
  const std::lock_guard lock(mutex_);
  core::ObjectPage page;
  for (auto next = objects_.lower_bound(prefix); next != objects_.end(); ++next) {
    if (!next->first.starts_with(prefix)) break;
    if (!after.empty() && next->first <= after) continue;
    if (page.objects.size() == limit) {
      page.has_more = true;
      break;
    }
    page.objects.push_back({next->first, next->second.bytes.size(), next->second.modified_ms});
  }
  return page;
}

Result<core::ObjectInfo> MemoryObjectStore::Head(std::string_view key, const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kHead, key, cancel);
  if (!fault.ok()) return fault.error();
  if (*fault == Fault::kLostAnswer || *fault == Fault::kLate) {
    return core::StoreIsAway("the answer was lost");
  }
  const std::lock_guard lock(mutex_);
  const auto found = objects_.find(key);
  if (found == objects_.end()) return NotThere();
  return core::ObjectInfo{found->first, found->second.bytes.size(), found->second.modified_ms};
}

Status MemoryObjectStore::Get(std::string_view key, std::uint64_t offset, std::span<std::byte> out,
                              const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kGet, key, cancel);
  if (!fault.ok()) return fault.error();
  if (*fault == Fault::kLostAnswer || *fault == Fault::kLate) {
    return core::StoreIsAway("the answer was lost");
  }
  const std::lock_guard lock(mutex_);
  const auto found = objects_.find(key);
  if (found == objects_.end()) return NotThere();
  const std::vector<std::byte>& bytes = found->second.bytes;
  if (offset > bytes.size() || out.size() > bytes.size() - offset) {
    return Error{ErrorCode::kCorrupt, "the object ends earlier"};
  }
  std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
  if (*fault == Fault::kAltered) out[out.size() / 2] ^= std::byte{1};
  return {};
}

Status MemoryObjectStore::Put(std::string_view key, std::span<const std::byte> bytes,
                              core::PutMode mode, const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kPut, key, cancel);
  if (!fault.ok()) return fault.error();
  return Write(
      *fault, key,
      [this, key = std::string(key), copy = std::vector<std::byte>(bytes.begin(), bytes.end()),
       mode] { PutLocked(key, copy, mode); });
}

Status MemoryObjectStore::Delete(std::string_view key, const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kDelete, key, cancel);
  if (!fault.ok()) return fault.error();
  return Write(*fault, key, [this, key = std::string(key)] { objects_.erase(key); });
}

Result<std::string> MemoryObjectStore::BeginParts(std::string_view key, const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kBeginParts, key, cancel);
  if (!fault.ok()) return fault.error();
  const std::lock_guard lock(mutex_);
  if (*fault == Fault::kLate) return core::StoreIsAway("the answer was lost");
  const std::string upload = "upload" + std::to_string(next_upload_++);
  uploads_[upload].key = key;
  if (*fault == Fault::kLostAnswer) return core::StoreIsAway("the answer was lost");
  return upload;
}

Result<std::string> MemoryObjectStore::PutPart(std::string_view key, std::string_view upload,
                                               int number, std::span<const std::byte> bytes,
                                               const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kPutPart, key, cancel);
  if (!fault.ok()) return fault.error();
  const std::lock_guard lock(mutex_);
  const auto found = uploads_.find(upload);
  if (found == uploads_.end()) return NotThere();
  if (*fault == Fault::kLate) return core::StoreIsAway("the answer was lost");
  found->second.parts[number].assign(bytes.begin(), bytes.end());
  if (*fault == Fault::kLostAnswer) return core::StoreIsAway("the answer was lost");
  return "tag" + std::to_string(number);
}

Status MemoryObjectStore::FinishParts(std::string_view key, std::string_view upload,
                                      std::span<const std::string> tags, core::PutMode mode,
                                      const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kFinishParts, key, cancel);
  if (!fault.ok()) return fault.error();
  {
    const std::lock_guard lock(mutex_);
    const auto found = uploads_.find(upload);
    if (found == uploads_.end()) return NotThere();
    int number = 1;
    for (const std::string& tag : tags) {
      if (tag != "tag" + std::to_string(number) || !found->second.parts.contains(number)) {
        return Error{ErrorCode::kInternal, "a wrong tag"};
      }
      ++number;
    }
  }
  return Write(*fault, key, [this, key = std::string(key), upload = std::string(upload), mode] {
    const auto found = uploads_.find(upload);
    if (found == uploads_.end()) return;
    std::vector<std::byte> all;
    for (const auto& [number, part] : found->second.parts) {
      all.insert(all.end(), part.begin(), part.end());
    }
    uploads_.erase(found);
    PutLocked(key, std::move(all), mode);
  });
}

Status MemoryObjectStore::AbortParts(std::string_view key, std::string_view upload,
                                     const CancelToken& cancel) {
  const Result<Fault> fault = Begin(Call::kAbort, key, cancel);
  if (!fault.ok()) return fault.error();
  return Write(*fault, key, [this, upload = std::string(upload)] { uploads_.erase(upload); });
}

}  // namespace kdray::test
