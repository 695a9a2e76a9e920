// SPDX-License-Identifier: Apache-2.0
// A backend without geometry: meshes are any bytes, every tree is the plane z = 0 (fake_plane.h).
// For tests of the HTTP side.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "api/names.h"
#include "api/tree_id.h"
#include "core/base/hash.h"
#include "server/backend.h"
#include "tests/support/fake_plane.h"

namespace kdray::test {

/// Bytes that begin with "building" are never built, unless `finish_builds`; those that begin with
/// "broken" are no mesh. Queries take the time of FakeWork.
class FakeBackend final : public server::Backend, public FakeWork {
 public:
  std::atomic<bool> finish_builds{false};
  std::atomic<bool> was_shut_down{false};
  /// What the next uploads are refused with.
  std::optional<api::Problem> upload_problem;

  api::Outcome<std::unique_ptr<server::MeshUpload>> BeginUpload(std::uint64_t) override {
    if (upload_problem) return *upload_problem;
    return std::unique_ptr<server::MeshUpload>(std::make_unique<Upload>(*this));
  }

  api::Outcome<server::MeshUpload::Stored> BuildStored(std::string_view sha256,
                                                       api::Build build) override {
    std::string bytes;
    {
      const std::lock_guard lock(mutex_);
      const auto mesh = std::find_if(trees_.begin(), trees_.end(), [&](const auto& tree) {
        return tree.first.substr(0, 64) == sha256;
      });
      if (mesh == trees_.end()) {
        return api::Problem{.code = api::ErrorCode::kMeshNotFound, .detail = "no such mesh"};
      }
      bytes = mesh->second;
    }
    return Store(bytes, build);
  }

  api::Check Find(std::string_view id) override {
    const auto tree = DescribeNow(id);
    if (tree) return std::nullopt;
    return tree.problem();
  }

  api::Outcome<api::TreeDescription> Describe(std::string_view id,
                                              std::chrono::steady_clock::time_point until,
                                              const server::CancelToken& cancel) override {
    for (;;) {
      auto tree = DescribeNow(id);
      if (!tree || tree->ready || cancel.ShouldStop() ||
          std::chrono::steady_clock::now() >= until) {
        return tree;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

  api::Outcome<std::unique_ptr<const server::LoadedTree>> Acquire(
      std::string_view id, server::TreeUse, const server::CancelToken& cancel) override {
    const auto tree = Describe(id, cancel.deadline(), cancel);
    if (!tree) return tree.problem();
    if (!tree->ready) {
      return api::Problem{.code = api::ErrorCode::kTreeBuilding, .detail = "not built yet"};
    }
    return std::unique_ptr<const server::LoadedTree>(std::make_unique<FakePlane>(*this));
  }

  api::Outcome<api::TreePage> List(std::string_view mesh, std::size_t limit,
                                   std::string_view after) override {
    const std::lock_guard lock(mutex_);
    api::TreePage page;
    for (const auto& [id, bytes] : trees_) {
      if (id <= after || (!mesh.empty() && id.substr(0, 64) != mesh)) continue;
      if (page.trees.size() == limit) {
        page.next = page.trees.back().id;
        break;
      }
      if (auto tree = Describe(id, bytes)) page.trees.push_back(*std::move(tree));
    }
    return page;
  }

  api::Check Delete(std::string_view id) override {
    const std::lock_guard lock(mutex_);
    return trees_.erase(std::string(id)) == 0 ? api::Check(NotFound()) : std::nullopt;
  }

  api::Outcome<std::unique_ptr<server::MeshBytes>> OpenMesh(std::string_view id,
                                                            const server::CancelToken&) override {
    const std::lock_guard lock(mutex_);
    const auto tree = trees_.find(std::string(id));
    if (tree == trees_.end()) return NotFound();
    return std::unique_ptr<server::MeshBytes>(std::make_unique<Bytes>(tree->second));
  }

  api::Check Measure(std::string_view id) override {
    const std::lock_guard lock(mutex_);
    if (trees_.find(std::string(id)) == trees_.end()) return NotFound();
    measured_.emplace(std::string(id), false);
    return std::nullopt;
  }
  api::Outcome<api::Tradeoff> WaitForTradeoff(std::string_view id,
                                              std::chrono::steady_clock::time_point,
                                              const server::CancelToken&) override {
    const std::lock_guard lock(mutex_);
    if (trees_.find(std::string(id)) == trees_.end()) return NotFound();
    const auto found = measured_.find(std::string(id));
    if (found == measured_.end()) return NotMeasured();
    found->second = found->second || !hold;
    api::Tradeoff tradeoff;
    tradeoff.ready = found->second;
    tradeoff.progress = 0.5;
    if (tradeoff.ready) tradeoff.results.resize(24);
    return tradeoff;
  }
  api::Check ForgetTradeoff(std::string_view id) override {
    const std::lock_guard lock(mutex_);
    if (trees_.find(std::string(id)) == trees_.end()) return NotFound();
    if (measured_.erase(std::string(id)) == 0) return NotMeasured();
    return std::nullopt;
  }

  server::BackendCounters counters() const override {
    server::BackendCounters values;
    values.builds = 7;
    return values;
  }

  void Shutdown() override { was_shut_down = true; }

 private:
  class Upload final : public server::MeshUpload {
   public:
    explicit Upload(FakeBackend& backend) : backend_(backend) {}
    api::Check Append(std::span<const std::byte> bytes) override {
      bytes_.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
      return std::nullopt;
    }
    api::Outcome<Stored> Finish(api::Build build) override { return backend_.Store(bytes_, build); }

   private:
    FakeBackend& backend_;
    std::string bytes_;
  };

  class Bytes final : public server::MeshBytes {
   public:
    explicit Bytes(std::string bytes) : bytes_(std::move(bytes)) {}
    std::uint64_t size() const override { return bytes_.size(); }
    bool Read(std::uint64_t offset, std::span<std::byte> out) const override {
      if (offset + out.size() > bytes_.size()) return false;
      std::memcpy(out.data(), bytes_.data() + offset, out.size());
      return true;
    }

   private:
    std::string bytes_;
  };

  static api::Problem NotMeasured() {
    return {.code = api::ErrorCode::kNotMeasured, .detail = "nothing measured"};
  }
  static api::Problem NotFound() {
    return {.code = api::ErrorCode::kTreeNotFound, .detail = "no such tree"};
  }

  api::Outcome<api::TreeDescription> DescribeNow(std::string_view id) const {
    const std::lock_guard lock(mutex_);
    const auto tree = trees_.find(std::string(id));
    if (tree == trees_.end()) return NotFound();
    return Describe(tree->first, tree->second);
  }

  api::Outcome<server::MeshUpload::Stored> Store(const std::string& bytes, api::Build build) {
    const std::string id =
        api::FormatTreeId(core::HashBytes(std::as_bytes(std::span(bytes))).ToHex(), build);
    const std::lock_guard lock(mutex_);
    const bool existed = !trees_.emplace(id, bytes).second;
    return server::MeshUpload::Stored{id, existed};
  }

  api::Outcome<api::TreeDescription> Describe(const std::string& id,
                                              const std::string& bytes) const {
    if (bytes.starts_with("broken")) {
      return api::Problem{
          .code = api::ErrorCode::kInvalidMesh, .detail = "it is broken", .line = 1};
    }
    api::TreeDescription tree;
    tree.id = id;
    tree.ready = finish_builds || !bytes.starts_with("building");
    tree.progress = tree.ready ? 1 : 0.5;
    tree.created_at = "2024-01-01T00:00:00.000Z";
    tree.mesh.sha256 = id.substr(0, 64);
    tree.mesh.bytes = bytes.size();
    if (tree.ready) tree.tree.emplace().build_ms = 1;
    return tree;
  }

  mutable std::mutex mutex_;
  std::map<std::string, std::string> trees_;  ///< id to mesh bytes
  std::map<std::string, bool> measured_;      ///< id to whether it has ended; not while `hold`
};

}  // namespace kdray::test
