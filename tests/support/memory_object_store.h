// SPDX-License-Identifier: Apache-2.0
// An object store in memory, with the faults of a real one: it is away, carries a request out but
// loses the answer, carries it out late, alters or cuts what it sends, or refuses.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/store/object_store.h"

namespace kdray::test {

/// Safe from many threads at once.
class MemoryObjectStore final : public core::ObjectStore {
 public:
  enum class Fault {
    kNone,
    kAway,        ///< not carried out
    kLostAnswer,  ///< carried out, and reported as away
    kLate,        ///< reported as away, and carried out by DeliverLate (writes only)
    kAltered,     ///< a byte of what Get returns is wrong
    kTruncated,   ///< kCorrupt, as an answer that ends too early
    kRefused,
  };
  enum class Call {
    kList,
    kHead,
    kGet,
    kPut,
    kDelete,
    kBeginParts,
    kPutPart,
    kFinishParts,
    kAbort
  };
  /// Called for each call, perhaps from many threads, without a lock; decides its fault.
  using Faults = std::function<Fault(Call call, std::string_view key)>;

  void set_faults(Faults faults);
  /// Without conditional writes, PutMode::kKeep replaces, as kReplace does.
  void set_conditional_writes(bool has_them);
  /// Carries out the writes that are late, in their order: those of keys with `part` in them.
  void DeliverLate(std::string_view part = "");

  std::vector<std::string> Keys(std::string_view prefix = "") const;
  std::vector<std::byte> Contents(const std::string& key) const;
  void SetContents(const std::string& key, std::vector<std::byte> contents);
  void Erase(const std::string& key);
  /// Makes all objects older.
  void Age(std::int64_t ms);
  /// The store's clock is this much ahead of the machine's.
  void SetClock(std::int64_t ahead_ms);
  std::uint64_t calls(Call call) const;
  /// Calls since the start.
  std::uint64_t calls() const;
  /// Uploads in parts that were neither finished nor aborted.
  std::size_t unfinished_uploads() const;

  std::int64_t NowMs() const override;
  core::Result<core::ObjectPage> List(std::string_view prefix, std::string_view after,
                                      std::size_t limit, const core::CancelToken& cancel) override;
  core::Result<core::ObjectInfo> Head(std::string_view key,
                                      const core::CancelToken& cancel) override;
  core::Status Get(std::string_view key, std::uint64_t offset, std::span<std::byte> out,
                   const core::CancelToken& cancel) override;
  core::Status Put(std::string_view key, std::span<const std::byte> bytes, core::PutMode mode,
                   const core::CancelToken& cancel) override;
  core::Status Delete(std::string_view key, const core::CancelToken& cancel) override;
  core::Result<std::string> BeginParts(std::string_view key,
                                       const core::CancelToken& cancel) override;
  core::Result<std::string> PutPart(std::string_view key, std::string_view upload, int number,
                                    std::span<const std::byte> bytes,
                                    const core::CancelToken& cancel) override;
  core::Status FinishParts(std::string_view key, std::string_view upload,
                           std::span<const std::string> tags, core::PutMode mode,
                           const core::CancelToken& cancel) override;
  core::Status AbortParts(std::string_view key, std::string_view upload,
                          const core::CancelToken& cancel) override;

 private:
  struct Object {
    std::vector<std::byte> bytes;
    std::int64_t modified_ms = 0;
  };
  struct Late {
    std::string key;
    std::function<void()> write;
  };
  struct Upload {
    std::string key;
    std::map<int, std::vector<std::byte>> parts;
  };
  // The fault of a call; counts it. An error ends the call before it is carried out.
  core::Result<Fault> Begin(Call call, std::string_view key, const core::CancelToken& cancel);
  core::Status Write(Fault fault, std::string_view key, std::function<void()> write);
  void PutLocked(const std::string& key, std::vector<std::byte> bytes, core::PutMode mode);

  mutable std::mutex mutex_;
  std::shared_ptr<Faults> faults_;
  bool has_conditional_writes_ = true;
  std::map<std::string, Object, std::less<>> objects_;
  std::map<std::string, Upload, std::less<>> uploads_;
  std::vector<Late> late_;
  std::map<Call, std::uint64_t> calls_;
  std::atomic<std::int64_t> ahead_ms_{0};
  int next_upload_ = 1;
};

}  // namespace kdray::test
