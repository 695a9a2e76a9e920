// SPDX-License-Identifier: Apache-2.0
#include "core/library/binary_rebuilder.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <new>
#include <utility>

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

// Threads of their own: a long rebuild takes no place from the loads and builds of the library.
constexpr int kThreads = 2;

// Poll interval; a CancelToken has no notification.
constexpr std::chrono::milliseconds kLookAgain{50};

// These messages are short enough to need no memory.
Error Stopped() { return Error{ErrorCode::kCancelled, "shutting down"}; }
Error OutOfMemory() { return Error{ErrorCode::kMemoryFull, "out of memory"}; }

}  // namespace

struct BinaryRebuilder::Rebuild {
  explicit Rebuild(Scene of) : scene(std::move(of)) {}

  const Scene scene;
  const CancelToken cancel = CancelToken::Cancellable();

  // Guarded by the rebuilder's mutex.
  int askers = 0;
  bool has_ended = false;
  Status status;  // once it has ended
  std::condition_variable ended;
};

BinaryRebuilder::BinaryRebuilder(MemoryBudget* budget, Arena* arena)
    : budget_(budget), arena_(arena), queue_(0, kThreads, 0) {}

BinaryRebuilder::~BinaryRebuilder() { Stop(); }

Status BinaryRebuilder::Ensure(const Sha256Digest& mesh, const Scene& scene,
                               const CancelToken& cancel) {
  std::shared_ptr<Rebuild> rebuild;  // its scene may be the last of a large tree: let go unlocked
  std::unique_lock lock(mutex_);
  if (scene.tree->kept_binary() != nullptr) return {};
  if (stopped_) return Stopped();
  rebuild = Join(mesh, scene);
  ++rebuild->askers;
  while (!rebuild->has_ended && !cancel.ShouldStop()) {
    rebuild->ended.wait_until(lock, std::min(cancel.deadline(), SteadyClock::now() + kLookAgain));
  }
  --rebuild->askers;
  if (rebuild->has_ended) return rebuild->status;
  if (rebuild->askers == 0) {
    // Whoever asks later begins anew.
    rebuild->cancel.Cancel();
    End(rebuild.get(), Status());
  }
  return cancel.ToError();
}

std::shared_ptr<BinaryRebuilder::Rebuild> BinaryRebuilder::Join(const Sha256Digest& mesh,
                                                                const Scene& scene) {
  if (const auto found = under_way_.find(scene.tree.get()); found != under_way_.end()) {
    return found->second;
  }
  auto rebuild = std::make_shared<Rebuild>(scene);
  const auto place = under_way_.emplace(scene.tree.get(), rebuild).first;
  try {
    queue_.Submit(mesh, WorkQueue::Lane::kBuild, [this, rebuild] { Run(rebuild); });
  } catch (...) {
    under_way_.erase(place);
    throw;
  }
  return rebuild;
}

void BinaryRebuilder::Run(const std::shared_ptr<Rebuild>& rebuild) noexcept {
  Status status;
  try {
    status = Make(*rebuild);
  } catch (const std::bad_alloc&) {
    status = OutOfMemory();
  } catch (...) {
    status = Error{ErrorCode::kInternal, "a failure"};
  }
  const std::lock_guard lock(mutex_);
  End(rebuild.get(), std::move(status));
}

Status BinaryRebuilder::Make(const Rebuild& rebuild) {
  if (rebuild.cancel.ShouldStop()) return rebuild.cancel.ToError();
  const TriangleMesh& mesh = *rebuild.scene.mesh;
  const Tree& tree = *rebuild.scene.tree;
  const std::uint64_t own_bytes = mesh.bytes() + tree.most_bytes();
  const std::uint64_t rest = budget_->limit() - std::min(own_bytes, budget_->limit());
  const std::uint64_t bytes = std::min(EstimateBuildBytes(mesh.triangle_count(), tree.build), rest);
  const std::optional<MemoryCharge> charge = budget_->TryReserve(bytes);
  if (!charge) {
    return Error{ErrorCode::kMemoryFull, "other work holds the memory that the tree's cells need"};
  }
  Status status;
  arena_->Run([&] {
    const auto made = tree.Binary(mesh, BuildOptions{rebuild.cancel});
    if (!made.ok()) status = made.error();
  });
  if (status.ok()) ++rebuilds_;
  return status;
}

// Only the first end counts.
void BinaryRebuilder::End(Rebuild* rebuild, Status status) noexcept {
  if (rebuild->has_ended) return;
  rebuild->has_ended = true;
  rebuild->status = std::move(status);
  rebuild->ended.notify_all();
  under_way_.erase(rebuild->scene.tree.get());
}

void BinaryRebuilder::Stop() {
  {
    Rebuilds stopped;  // let go after the lock
    const std::lock_guard lock(mutex_);
    stopped_ = true;
    stopped.swap(under_way_);
    for (const auto& [tree, rebuild] : stopped) {
      rebuild->cancel.Cancel();
      End(rebuild.get(), Stopped());
    }
  }
  queue_.Stop();
}

}  // namespace kdray::core
