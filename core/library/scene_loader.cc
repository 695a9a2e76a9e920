// SPDX-License-Identifier: Apache-2.0
#include "core/library/scene_loader.h"

#include <algorithm>
#include <chrono>
#include <new>
#include <optional>
#include <utility>
#include <vector>

#include "core/accel/auto_choice.h"
#include "core/accel/expected_cost.h"
#include "core/base/progress.h"
#include "core/library/parse_mesh.h"

namespace kdray::core {

// One attempt with the available memory. An attempt that needs more says how much and holds nothing
// when it returns, so waiting for memory cannot deadlock.
class SceneLoader::Attempt {
 public:
  Attempt(SceneLoader* loader, const TreeRecord& record, LoadWatch* watch, MemoryCharge charge)
      : loader_(loader), record_(record), watch_(watch), charge_(std::move(charge)) {}

  Result<LoadedScene> Run(const std::function<void(const MeshFacts&)>& on_mesh) {
    if (Status status = FetchMesh(); !status.ok()) return std::move(status).error();
    watch_->parsed = true;
    on_mesh(loaded_.parsed->facts);
    if (Status status = FetchTree(); !status.ok()) return std::move(status).error();
    watch_->build_progress.Finish();
    return std::move(loaded_);
  }

  /// The memory for the whole work, if Run failed with kMemoryFull; else 0.
  std::uint64_t needed() const { return needed_; }

 private:
  // Ensures `bytes` in addition to what mesh and trees were charged, and returns the excess of the
  // previous step.
  // The attempt's initial charge is kept, because it was waited for.
  Status Need(std::uint64_t bytes) {
    charge_.Shrink(std::max(bytes, granted_));
    if (charge_.Grow(bytes)) return {};
    needed_ = charged_ + bytes;
    return Error{ErrorCode::kMemoryFull, "there is no memory for this now"};
  }

  Status FetchMesh() {
    const Sha256Digest& digest = record_.id.mesh;
    loaded_.parsed = loader_->cache_->FindMesh(digest);
    if (loaded_.parsed == nullptr) {
      Result<ParsedMesh> parsed = ReadParsed();
      if (!parsed.ok()) {
        if (MustEnd()) return std::move(parsed).error();
        parsed = Parse();
        loaded_.was_parsed = parsed.ok();
      }
      if (!parsed.ok()) return std::move(parsed).error();
      const std::uint64_t bytes = parsed->facts.memory_bytes;
      if (Status status = Need(bytes); !status.ok()) return status;
      charged_ += bytes;
      loaded_.parsed =
          loader_->cache_->InsertMesh(digest, *std::move(parsed), charge_.Split(bytes));
    }
    loaded_.scene.mesh = std::shared_ptr<const TriangleMesh>(loaded_.parsed, &loaded_.parsed->mesh);
    loaded_.scene.is_closed = loaded_.parsed->facts.health.closed;
    return {};
  }

  Result<ParsedMesh> ReadParsed() {
    // An expected file is read even if it is missing, so its loss is detected.
    const std::uint64_t expected = record_.mesh ? record_.mesh->memory_bytes : 0;
    const std::uint64_t bytes =
        std::max(expected, loader_->store_->ParsedFileBytes(record_.id.mesh));
    if (bytes == 0) return Error{ErrorCode::kNotFound, "not parsed yet"};
    if (Status status = Need(bytes); !status.ok()) return std::move(status).error();
    return loader_->store_->ReadParsed(record_.id.mesh, watch_->cancel);
  }

  Result<ParsedMesh> Parse() {
    if (Status status = Need(LeastParseBytes(record_.mesh_bytes)); !status.ok()) {
      return std::move(status).error();
    }
    Result<std::vector<std::byte>> bytes =
        loader_->store_->ReadMesh(record_.id.mesh, watch_->cancel);
    if (!bytes.ok()) return std::move(bytes).error();
    ++loader_->parses_;
    const auto on_counts = [&](const MeshCounts& counts) { return NeedForParsing(counts); };
    std::optional<Result<ParsedMesh>> parsed;
    loader_->arena_->Run([&] { parsed = ParseMesh(*std::move(bytes), watch_->cancel, on_counts); });
    if (parsed->ok() && !(*parsed)->group_names.empty()) {
      // Before anyone learns of the mesh. If the disk fails, a description reads them again.
      const std::vector<std::string> names = std::exchange((*parsed)->group_names, {});
      (void)loader_->store_->SaveGroupNames(record_.id.mesh, names);
    }
    return *std::move(parsed);
  }

  // The counts of the file are known; no memory is allocated for them yet.
  Status NeedForParsing(const MeshCounts& counts) {
    const std::uint64_t bytes = ParsePeakBytes(record_.mesh_bytes, counts);
    if (Status status = loader_->budget_->CheckCouldFit(bytes); !status.ok()) return status;
    return Need(bytes);
  }

  // A tree in memory.
  struct Fetched {
    std::shared_ptr<const Tree> tree;
    bool was_built = false;
    double build_ms = 0;  // if it was built
  };

  Status FetchTree() {
    std::optional<BuildKind> build = record_.id.build;
    if (!build && NeedsNoTree(loaded_.scene.mesh->triangle_count())) build = BuildKind::kBox;
    Result<Fetched> fetched = build ? Fetch(*build, &watch_->build_progress) : FetchAuto();
    if (!fetched.ok()) return std::move(fetched).error();
    loaded_.was_built = fetched->was_built;
    loaded_.tree.build = fetched->tree->build;
    loaded_.tree.stats = fetched->tree->stats;
    loaded_.tree.build_ms = fetched->build_ms;
    if (!fetched->was_built && record_.tree) loaded_.tree.build_ms = record_.tree->build_ms;
    loaded_.scene.tree = std::move(fetched->tree);
    return {};
  }

  // The tree that was chosen before, if it still exists; else chooses (auto_choice.h).
  Result<Fetched> FetchAuto() {
    if (record_.tree) {
      Result<Fetched> chosen = FetchMade(record_.tree->build);
      if (chosen.ok()) loaded_.choice = record_.choice;
      if (chosen.ok() || MustEnd()) return chosen;
    }
    AutoChoice& choice = loaded_.choice.emplace();
    Result<double> overlap = 0.0;
    loader_->arena_->Run([&] { overlap = BoxOverlap(*loaded_.scene.mesh, watch_->cancel); });
    if (!overlap.ok()) return std::move(overlap).error();
    choice.overlap = *overlap;
    if (choice.OverlapsLittle()) return Fetch(BuildKind::kBvh, &watch_->build_progress);

    // The first is the quick one; progress shows the other.
    Result<Fetched> bvh = Fetch(BuildKind::kBvh, nullptr);
    if (!bvh.ok()) return bvh;
    Result<Fetched> kd_sah = Fetch(BuildKind::kKdSah, &watch_->build_progress);
    if (!kd_sah.ok()) return kd_sah;
    const Result<double> bvh_cost = ExpectedCost(*bvh->tree, watch_->cancel);
    const Result<double> kd_sah_cost = ExpectedCost(*kd_sah->tree, watch_->cancel);
    if (!bvh_cost.ok()) return bvh_cost.error();
    if (!kd_sah_cost.ok()) return kd_sah_cost.error();
    choice.costs = {*bvh_cost, *kd_sah_cost};
    // The other tree stays in the cache until the task ends (TreeRemover::EvictUnwanted).
    Fetched chosen = choice.build() == BuildKind::kBvh ? *bvh : *kd_sah;
    if (chosen.was_built) chosen.build_ms = bvh->build_ms + kd_sah->build_ms;
    return chosen;
  }

  // Whether an error is not about the file that was read.
  bool MustEnd() const { return needed_ != 0 || watch_->cancel.ShouldStop(); }

  Result<Fetched> Fetch(BuildKind build, Progress* progress) {
    Result<Fetched> made = FetchMade(build);
    if (made.ok() || MustEnd()) return made;
    double build_ms = 0;
    Result<Tree> built = Build(build, progress, &build_ms);
    if (!built.ok()) return std::move(built).error();
    made = Insert(*std::move(built));
    if (made.ok()) {
      made->was_built = true;
      made->build_ms = build_ms;
    }
    return made;
  }

  // From the cache or its file.
  Result<Fetched> FetchMade(BuildKind build) {
    if (auto tree = loader_->cache_->FindTree(record_.id.mesh, build)) {
      return Fetched{.tree = std::move(tree)};
    }
    Result<Tree> read = ReadTree(build);
    if (!read.ok()) return std::move(read).error();
    ++loader_->loads_;
    return Insert(*std::move(read));
  }

  Result<Fetched> Insert(Tree tree) {
    const std::uint64_t bytes = tree.most_bytes();
    if (Status status = Need(bytes); !status.ok()) return std::move(status).error();
    charged_ += bytes;
    return Fetched{.tree = loader_->cache_->InsertTree(record_.id.mesh, std::move(tree),
                                                       charge_.Split(bytes))};
  }

  Result<Tree> ReadTree(BuildKind build) {
    const std::uint64_t bytes = loader_->store_->TreeFileBytes(record_.id.mesh, build);
    // The file is missing: reading it distinguishes a lost file from a damaged one.
    if (Status status = Need(bytes); !status.ok()) return std::move(status).error();
    return loader_->store_->ReadTree({record_.id.mesh, loaded_.scene.mesh->triangle_count(), build},
                                     watch_->cancel);
  }

  Result<Tree> Build(BuildKind build, Progress* progress, double* build_ms) {
    const TriangleMesh& mesh = *loaded_.scene.mesh;
    if (Status status = Need(EstimateBuildBytes(mesh.triangle_count(), build)); !status.ok()) {
      return std::move(status).error();
    }
    ++loader_->builds_;
    const auto start = std::chrono::steady_clock::now();
    std::optional<Result<BinaryTree>> binary;
    loader_->arena_->Run([&] {
      binary = BuildBinaryTree(mesh, build, BuildOptions{watch_->cancel, progress});
    });
    if (!binary->ok()) return (*binary).error();
    if (Status status = Need(EstimateFinishBytes(**binary)); !status.ok()) {
      return std::move(status).error();
    }
    std::optional<Result<Tree>> tree;
    loader_->arena_->Run([&] { tree = FinishTree(mesh, build, **binary, watch_->cancel); });
    *build_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    return *std::move(tree);
  }

  SceneLoader* loader_;
  const TreeRecord& record_;
  LoadWatch* watch_;
  MemoryCharge charge_;
  const std::uint64_t granted_ = charge_.bytes();
  std::uint64_t charged_ = 0;  // to mesh and trees
  std::uint64_t needed_ = 0;
  LoadedScene loaded_;
};

Result<MemoryCharge> SceneLoader::Reserve(std::uint64_t bytes, LoadWatch* watch,
                                          const Hooks& hooks) {
  if (Status status = budget_->CheckCouldFit(bytes); !status.ok()) return std::move(status).error();
  if (std::optional<MemoryCharge> charge = budget_->TryReserve(bytes)) return *std::move(charge);
  const std::optional<WorkQueue::Aside> aside = hooks.step_aside();
  if (!aside) {
    return Error{ErrorCode::kMemoryFull, "too much other work waits for memory already"};
  }
  return budget_->Reserve(bytes, watch->cancel, &watch->waits_for_memory);
}

Result<LoadedScene> SceneLoader::Load(const TreeRecord& record, LoadWatch* watch,
                                      const Hooks& hooks) {
  std::uint64_t needed = 0;
  try {
    for (;;) {
      Result<MemoryCharge> charge = Reserve(needed, watch, hooks);
      if (!charge.ok()) return std::move(charge).error();
      Attempt attempt(this, record, watch, *std::move(charge));
      Result<LoadedScene> loaded = attempt.Run(hooks.on_mesh);
      if (loaded.ok() || attempt.needed() == 0) return loaded;
      needed = std::max(needed + 1, attempt.needed());
    }
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemoryFull, "the system has no memory for this now"};
  }
}

void SceneLoader::Store(const TreeId& id, const LoadedScene& loaded, const CancelToken& cancel) {
  if (loaded.was_parsed) store_->WriteParsed(id.mesh, *loaded.parsed, cancel);
  if (loaded.was_built) {
    store_->WriteTree({id.mesh, loaded.scene.mesh->triangle_count(), loaded.tree.build},
                      *loaded.scene.tree, cancel);
  }
}

}  // namespace kdray::core
