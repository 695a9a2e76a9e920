// SPDX-License-Identifier: Apache-2.0
// What the tests of the backend share: one on a disk of its own, a mesh, and rays.
// core_backend_test.cc has meshes and trees, core_backend_rays_test.cc batches of rays,
// core_backend_render_test.cc pictures and cells.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/geometry/ray.h"
#include "server/core_backend.h"
#include "tests/support/off_text.h"
#include "tests/support/ray_rows.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"
#include "tests/support/simulated_disk.h"

namespace kdray::server {

using MeshBytesVector = std::vector<std::byte>;

/// The rows of an answer, and its report.
template <class Rows>
struct Answer {
  std::shared_ptr<test::Collected<Rows>> rows = std::make_shared<test::Collected<Rows>>();
  api::BatchReport report;
};
using ClosestAnswer = Answer<api::ClosestRows>;
using AnyAnswer = Answer<api::AnyRows>;
using CountAnswer = Answer<api::CountRows>;
using AllAnswer = Answer<api::AllRows>;

class CoreBackendTest : public testing::Test {
 protected:
  CoreBackendTest() {
    options_.data_dir = "data";
    options_.threads = 2;
    options_.file_system = &disk_;
    Open();
  }
  void Open() {
    backend_.reset();
    auto backend = MakeCoreBackend(options_);
    ASSERT_TRUE(backend.ok()) << backend.error().message;
    backend_ = *std::move(backend);
  }
  static CancelToken Soon() {
    return CancelToken::WithDeadline(std::chrono::steady_clock::now() + std::chrono::minutes(2));
  }
  api::Outcome<MeshUpload::Stored> Upload(const MeshBytesVector& bytes,
                                          api::Build build = api::Build::kAuto) {
    auto upload = backend_->BeginUpload(bytes.size());
    if (!upload.ok()) return upload.problem();
    if (api::Check check = (*upload)->Append(bytes)) return *std::move(check);
    return (*upload)->Finish(build);
  }
  std::string Add(const core::MeshData& mesh, api::Build build = api::Build::kAuto) {
    const auto stored = Upload(test::OffBytes(mesh), build);
    EXPECT_TRUE(stored.ok());
    const auto built = backend_->Describe(
        stored->id, std::chrono::steady_clock::now() + std::chrono::minutes(2), CancelToken());
    EXPECT_TRUE(built.ok() && built->ready);
    return stored->id;
  }

  api::Outcome<api::TreeDescription> DescribeNow(std::string_view id) {
    return backend_->Describe(id, std::chrono::steady_clock::now(), CancelToken());
  }

  // One request: acquires the tree, asks it once, and lets it go.
  api::Outcome<ClosestAnswer> Closest(std::string_view id, const api::RayTable& rays,
                                      const api::RayOptions& options, const CancelToken& cancel) {
    return Ask<ClosestAnswer>(id, rays, options, cancel, &LoadedTree::Closest);
  }
  api::Outcome<AnyAnswer> Any(std::string_view id, const api::RayTable& rays,
                              const api::RayOptions& options, const CancelToken& cancel) {
    return Ask<AnyAnswer>(id, rays, options, cancel, &LoadedTree::Any);
  }
  api::Outcome<CountAnswer> Count(std::string_view id, const api::RayTable& rays,
                                  const api::RayOptions& options, const CancelToken& cancel) {
    return Ask<CountAnswer>(id, rays, options, cancel, &LoadedTree::Count);
  }
  api::Outcome<AllAnswer> All(std::string_view id, const api::RayTable& rays,
                              const api::RayOptions& options, const CancelToken& cancel) {
    return Ask<AllAnswer>(id, rays, options, cancel, &LoadedTree::All);
  }
  template <class Answer, class Method>
  api::Outcome<Answer> Ask(std::string_view id, const api::RayTable& rays,
                           const api::RayOptions& options, const CancelToken& cancel,
                           Method method) {
    const auto tree = backend_->Acquire(id, TreeUse::kRays, cancel);
    if (!tree) return tree.problem();
    Answer answer;
    auto report = ((**tree).*method)(rays, options, cancel, answer.rows.get());
    if (!report) return report.problem();
    answer.report = *std::move(report);
    return answer;
  }
  api::Outcome<api::RenderAnswer> Render(std::string_view id, const api::RenderRequest& request,
                                         bool png, const CancelToken& cancel) {
    const auto tree =
        backend_->Acquire(id, NeedsBinaryTree(request) ? TreeUse::kCells : TreeUse::kRays, cancel);
    if (!tree) return tree.problem();
    return (*tree)->Render(request, png, cancel);
  }
  static bool NeedsBinaryTree(const api::RenderRequest& request) {
    return request.cells_depth || request.mode == api::RenderMode::kCost;
  }
  api::Outcome<std::vector<api::Cell>> Cells(std::string_view id, std::uint32_t depth,
                                             const CancelToken& cancel) {
    const auto tree = backend_->Acquire(id, TreeUse::kCells, cancel);
    if (!tree) return tree.problem();
    return (*tree)->Cells(depth, cancel);
  }

  test::SimulatedDisk disk_;
  CoreBackendOptions options_;
  std::unique_ptr<Backend> backend_;
};

inline core::MeshData Sphere() { return test::BumpySphere({1, 2, 3}, 2, 12, 24, 0.2); }

// Rays through and past the sphere; every 10th is invalid.
template <class T>
test::RayRows<T> SomeRays(std::size_t count) {
  std::mt19937_64 random = test::RandomEngine(4242);
  std::uniform_real_distribution<T> place(T(-5), T(9));
  std::vector<test::RayRow<T>> rows(count);
  for (std::size_t i = 0; i < count; ++i) {
    test::RayRow<T>& r = rows[i];
    r.ox = place(random);
    r.oy = place(random);
    r.oz = place(random);
    r.t_min = 0;
    r.t_max = std::numeric_limits<T>::infinity();
    r.dx = T(1) - r.ox + place(random) / T(4);
    r.dy = T(2) - r.oy + place(random) / T(4);
    r.dz = T(3) - r.oz;
    if (i % 10 == 7) r.dx = std::numeric_limits<T>::quiet_NaN();
  }
  return test::RayRows<T>(std::move(rows));
}

inline core::Ray RayOf(const test::RayRow<double>& r) {
  return {core::Vec3d{r.ox, r.oy, r.oz}, r.t_min, core::Vec3d{r.dx, r.dy, r.dz}, r.t_max};
}

inline void ExpectSame(const api::RayHit& a, const api::RayHit& b) {
  EXPECT_TRUE(a.triangle == b.triangle && a.u == b.u && a.v == b.v &&
              (a.t == b.t || (std::isnan(a.t) && std::isnan(b.t))));
}

}  // namespace kdray::server
