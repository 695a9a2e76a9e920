// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/kernel_choice.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "core/geometry/hit.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

class KernelChoice : public testing::Test {
 protected:
  KernelJob Choose(const std::vector<RayF>& rays, Precision precision, bool any = false) {
    KernelJob job;
    job.tree = &scene_.tree->wide;
    job.mesh = scene_.mesh.get();
    job.precision = precision;
    job.rays = std::span<const RayF>(rays);
    occluded_.resize(rays.size());
    hits_.resize(rays.size());
    if (any) {
      job.occluded = occluded_.data();
    } else {
      job.hits = hits_.data();
    }
    ChooseKernel({}, &job);
    return job;
  }

  const Scene scene_ = test::MakeScene(test::UvSphere({0, 0, 0}, 1, 20, 40));
  std::vector<std::uint8_t> occluded_;
  std::vector<Hit> hits_;
  std::mt19937 engine_{11};
  std::uniform_real_distribution<float> any_{-1, 1};

  Vec3f Random() { return {any_(engine_), any_(engine_), any_(engine_)}; }
  std::vector<RayF> Camera() const {
    std::vector<RayF> rays;
    for (int i = 0; i < 20000; ++i) {
      rays.push_back({{0, 0, 3}, 0, {static_cast<float>(i) * 1e-5F, 0.1F, -1}});
    }
    return rays;
  }
};

TEST_F(KernelChoice, ACamerasRaysAreAFrustum) {
  for (const Precision precision : kAllPrecisions) {
    for (const bool any : {false, true}) {
      EXPECT_EQ(Choose(Camera(), precision, any).kernel, KernelKind::kFrustum);
    }
  }
  EXPECT_FALSE(Choose(Camera(), Precision::kFast).sort);
}

TEST_F(KernelChoice, ShuffledRaysAreSortedWhereManyAreAlike) {
  std::vector<RayF> from_surface, random;
  for (int i = 0; i < 20000; ++i) {
    // 256 cells of 4,096.
    const Vec3f at = Random();
    from_surface.push_back({{at.x, at.y, 0.9F}, 0, Random()});
    random.push_back({at, 0, Random()});
  }
  for (const bool any : {false, true}) {
    const KernelJob alike = Choose(from_surface, Precision::kDouble, any);
    EXPECT_TRUE(alike.sort);
    EXPECT_EQ(alike.kernel, any ? KernelKind::kFrustum : KernelKind::kStream);
    const KernelJob unlike = Choose(random, Precision::kDouble, any);
    EXPECT_FALSE(unlike.sort);
    EXPECT_EQ(unlike.kernel, KernelKind::kInterleaved);
  }
  // What the frustum hands on goes the same ways.
  EXPECT_TRUE(Choose(from_surface, Precision::kFast).alike);
  EXPECT_FALSE(Choose(random, Precision::kFast).alike);

  // A small batch is not looked at so closely.
  from_surface.resize(1000);
  EXPECT_FALSE(Choose(from_surface, Precision::kDouble).sort);
}

}  // namespace
}  // namespace kdray::core
