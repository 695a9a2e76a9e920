// SPDX-License-Identifier: Apache-2.0
// A TreeLibrary on a simulated disk, and what its tests do with it.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/library/tree_library.h"
#include "core/trace/trace.h"
#include "tests/support/mesh_files.h"
#include "tests/support/off_text.h"
#include "tests/support/shapes.h"
#include "tests/support/simulated_disk.h"

namespace kdray::test {

inline core::CancelToken Within(std::chrono::milliseconds time) {
  return core::CancelToken::WithDeadline(std::chrono::steady_clock::now() + time);
}
/// Long enough for whatever should happen, on the slowest machine.
inline core::CancelToken Soon() { return Within(std::chrono::minutes(2)); }

/// Meshes that differ in their bytes: a small closed sphere somewhere.
inline std::vector<std::byte> SphereBytes(int number, int rings = 8) {
  return OffBytes(UvSphere({number * 0.5, 1, -2}, 1 + 0.1 * number, rings, 2 * rings));
}

inline core::Sha256Digest DigestOf(const std::vector<std::byte>& bytes) {
  return core::HashBytes(bytes);
}

inline core::Result<core::TreeLibrary::Added> Upload(
    core::TreeLibrary* library, const std::vector<std::byte>& bytes,
    std::optional<core::BuildKind> build = std::nullopt) {
  auto upload = library->BeginUpload(bytes.size());
  if (!upload.ok()) return std::move(upload).error();
  const std::size_t half = bytes.size() / 2;
  const auto all = std::span<const std::byte>(bytes);
  for (const auto piece : {all.first(half), all.subspan(half)}) {
    if (core::Status status = upload->Append(piece); !status.ok()) {
      return std::move(status).error();
    }
  }
  return library->Finish(*std::move(upload), build);
}

/// Closest hits of a fan of rays from around the mesh: what must not change whatever happens to
/// the files.
inline std::vector<core::Hit> Answers(const core::Scene& scene) {
  std::vector<core::Ray> rays;
  const core::Bounds3d& box = scene.mesh->bounds();
  for (int i = 0; i < 64; ++i) {
    core::Ray ray;
    ray.origin = box.max + box.Extent() * (0.1 + 0.01 * i);
    const core::Vec3d target =
        box.min + core::Vec3d{box.Extent().x * (i % 4) / 3, box.Extent().y * (i / 4 % 4) / 3,
                              box.Extent().z * static_cast<double>(i / 16) / 3};
    ray.direction = target - ray.origin;
    rays.push_back(ray);
  }
  std::vector<core::Hit> hits(rays.size());
  EXPECT_TRUE(core::TraceClosest(scene, std::span<const core::Ray>(rays), {}, hits).ok());
  return hits;
}

inline std::vector<core::Hit> AnswersOf(core::TreeLibrary* library, const core::TreeId& id) {
  const auto scene = library->Load(id, Soon());
  if (!scene.ok()) {
    ADD_FAILURE() << "no answer: " << scene.error().message;
    return {};
  }
  return Answers(*scene);
}

class LibraryTest : public testing::Test {
 protected:
  LibraryTest() {
    options_.data_dir = "data";
    options_.file_system = &disk_;
    options_.memory_limit_bytes = std::uint64_t{1} << 30;
  }

  /// Ends the library that runs, if any, in good order, and starts one on what is on the disk.
  void Open() {
    library_.reset();
    auto library = core::TreeLibrary::Open(options_);
    ASSERT_TRUE(library.ok()) << library.error().message;
    library_ = *std::move(library);
  }
  /// Uploads and waits until it is built.
  core::TreeId Add(const std::vector<std::byte>& bytes,
                   std::optional<core::BuildKind> build = std::nullopt) {
    const auto added = Upload(library_.get(), bytes, build);
    EXPECT_TRUE(added.ok()) << added.error().message;
    if (!added.ok()) return {};
    EXPECT_TRUE(library_->Load(added->id, Soon()).ok());
    return added->id;
  }
  /// Waits until what was built is on disk as well, as far as its files have less than a MiB.
  void Settle() {
    library_->Shutdown();
    Open();
  }
  core::ErrorCode CodeOfFind(const core::TreeId& id) {
    const auto info = library_->Find(id);
    return info.ok() ? core::ErrorCode::kInternal : info.error().code;
  }
  std::size_t FilesIn(const char* folder) const {
    return disk_.FilesIn(std::filesystem::path("data") / folder).size();
  }

  SimulatedDisk disk_;
  core::LibraryOptions options_;
  std::unique_ptr<core::TreeLibrary> library_;
};

}  // namespace kdray::test
