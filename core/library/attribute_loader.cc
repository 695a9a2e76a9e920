// SPDX-License-Identifier: Apache-2.0
#include "core/library/attribute_loader.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <new>
#include <optional>
#include <utility>
#include <vector>

#include "core/library/parse_mesh.h"

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;
using AttributesPointer = TreeCache::AttributesPointer;

// Threads of their own: a long reading takes no place from the loads and builds of the library.
constexpr int kThreads = 2;

// Poll interval; a CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};

// These messages are short enough to need no memory.
Error Stopped() { return Error{ErrorCode::kCancelled, "shutting down"}; }
Error OutOfMemory() { return Error{ErrorCode::kMemoryFull, "out of memory"}; }

}  // namespace

struct AttributeLoader::Reading {
  Reading(const Sha256Digest& of, std::uint64_t bytes, AttributeKinds asked)
      : mesh(of), file_bytes(bytes), kinds(asked) {}

  const Sha256Digest mesh;
  const std::uint64_t file_bytes;
  const AttributeKinds kinds;
  const CancelToken cancel = CancelToken::Cancellable();

  // Guarded by the loader's mutex.
  int askers = 0;
  bool has_ended = false;
  Result<AttributesPointer> result = AttributesPointer();  // once it has ended
  std::condition_variable ended;
};

AttributeLoader::AttributeLoader(Parts parts) : parts_(std::move(parts)), queue_(0, kThreads, 0) {}

AttributeLoader::~AttributeLoader() { Stop(); }

Result<AttributesPointer> AttributeLoader::Load(const Sha256Digest& mesh, std::uint64_t file_bytes,
                                                AttributeKinds kinds, const CancelToken& cancel) {
  std::unique_lock lock(mutex_);
  for (;;) {
    AttributesPointer cached = parts_.cache->FindAttributes(mesh);
    if (cached != nullptr && cached->kinds().Contains(kinds)) return cached;
    if (stopped_) return Stopped();
    const auto found = under_way_.find(mesh);
    const std::shared_ptr<Reading> reading =
        found != under_way_.end()
            ? found->second
            : Begin(mesh, file_bytes, cached != nullptr ? kinds | cached->kinds() : kinds);
    cached.reset();
    ++reading->askers;
    while (!reading->has_ended && !cancel.ShouldStop()) {
      reading->ended.wait_until(lock, std::min(cancel.deadline(), SteadyClock::now() + kLookAgain));
    }
    --reading->askers;
    if (reading->has_ended) {
      // A reading of other kinds that was under way helps with the next one only.
      if (!reading->result.ok() || reading->kinds.Contains(kinds)) return reading->result;
      continue;
    }
    if (reading->askers == 0) {
      // Whoever asks later begins anew.
      reading->cancel.Cancel();
      End(reading.get(), Stopped());
    }
    return cancel.ToError();
  }
}

std::shared_ptr<AttributeLoader::Reading> AttributeLoader::Begin(const Sha256Digest& mesh,
                                                                 std::uint64_t file_bytes,
                                                                 AttributeKinds kinds) {
  auto reading = std::make_shared<Reading>(mesh, file_bytes, kinds);
  const auto place = under_way_.emplace(mesh, reading).first;
  try {
    queue_.Submit(mesh, WorkQueue::Lane::kBuild, [this, reading] { Run(reading); });
  } catch (...) {
    under_way_.erase(place);
    throw;
  }
  return reading;
}

void AttributeLoader::Run(const std::shared_ptr<Reading>& reading) noexcept {
  Result<AttributesPointer> result = Error{ErrorCode::kInternal, "a failure"};
  try {
    result = Read(*reading);
    if (result.ok()) parts_.evict_unwanted(reading->mesh);
  } catch (const std::bad_alloc&) {
    result = OutOfMemory();
  } catch (...) {
    result = Error{ErrorCode::kInternal, "a failure"};
  }
  const std::lock_guard lock(mutex_);
  End(reading.get(), std::move(result));
}

Result<AttributesPointer> AttributeLoader::Read(const Reading& reading) {
  if (reading.cancel.ShouldStop()) return reading.cancel.ToError();
  const std::uint64_t file_bytes = reading.file_bytes;
  std::optional<MemoryCharge> charge = parts_.budget->TryReserve(LeastParseBytes(file_bytes));
  const auto no_memory = [] {
    return Error{ErrorCode::kMemoryFull,
                 "other work holds the memory that reading the mesh's attributes needs"};
  };
  if (!charge) return no_memory();
  Result<std::vector<std::byte>> bytes = parts_.store->ReadMesh(reading.mesh, reading.cancel);
  if (!bytes.ok()) return std::move(bytes).error();
  ++reads_;
  MeshReadOptions options;
  options.cancel = reading.cancel;
  options.on_counts = [&](const MeshCounts& counts) -> Status {
    const std::uint64_t needed = ReadPeakBytes(file_bytes, counts);
    if (Status status = parts_.budget->CheckCouldFit(needed); !status.ok()) return status;
    return charge->Grow(needed) ? Status() : Status(no_memory());
  };
  Result<MeshAttributes> attributes = ReadAttributes(*bytes, reading.kinds, options);
  if (!attributes.ok()) return std::move(attributes).error();
  *bytes = std::vector<std::byte>();
  const std::uint64_t kept = attributes->bytes();
  if (!charge->Grow(kept)) return no_memory();
  charge->Shrink(kept);
  return parts_.cache->InsertAttributes(reading.mesh, *std::move(attributes), *std::move(charge));
}

// Only the first end counts.
void AttributeLoader::End(Reading* reading, Result<AttributesPointer> result) noexcept {
  if (reading->has_ended) return;
  reading->has_ended = true;
  reading->result = std::move(result);
  reading->ended.notify_all();
  under_way_.erase(reading->mesh);
}

void AttributeLoader::Stop() {
  {
    Readings stopped;
    const std::lock_guard lock(mutex_);
    stopped_ = true;
    stopped.swap(under_way_);
    for (const auto& [mesh, reading] : stopped) {
      reading->cancel.Cancel();
      End(reading.get(), Stopped());
    }
  }
  queue_.Stop();
}

}  // namespace kdray::core
