// SPDX-License-Identifier: Apache-2.0
// Ray queries end soon after their cancellation, whatever one ray costs: tokens are cancelled while
// the call works.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "core/tradeoff/ray_sets.h"
#include "tests/support/cancel_probe.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray {
namespace {

using core::BuildKind;
using core::CancelToken;
using core::ErrorCode;
using core::Hit;
using core::KernelKind;
using core::Precision;
using core::Ray;
using core::Scene;
using core::Status;
using std::chrono::milliseconds;
using test::ExpectPrompt;

constexpr core::Vec3d kApex = {0.1, 0.2, 0.3};

// Triangles around one apex. A ray through it meets them all, and `exact` must decide on each with
// more digits than a double has.
core::MeshData Fan(std::uint32_t triangles) {
  core::MeshData fan;
  fan.vertices.push_back(kApex);
  for (std::uint32_t i = 0; i < triangles; ++i) {
    const double angle = 2 * std::numbers::pi * i / triangles;
    fan.vertices.push_back(
        {std::cos(angle) + 0.1, std::sin(angle) + 0.2, -0.5 + 0.1 * std::sin(7 * angle)});
    fan.triangles.push_back({0, 1 + i, 1 + (i + 1) % triangles});
  }
  return fan;
}

Ray ThroughApex() {
  Ray ray;
  ray.origin = {0.1, 0.2, 2};
  ray.direction = {0, 0, -1};
  return ray;
}

// Rays from one point through the middle of Coincident's triangle, close together: a packet.
std::vector<Ray> Beam(const Scene& scene, std::size_t count) {
  core::Vec3d middle;
  for (int corner = 0; corner < 3; ++corner) {
    middle = middle + scene.mesh->frame().ToWorld(scene.mesh->LocalCorner(0, corner)) * (1.0 / 3);
  }
  std::vector<Ray> rays(count);
  for (std::size_t i = 0; i < count; ++i) {
    rays[i].origin = middle + core::Vec3d{3, 2, 5};
    const double across = 1e-3 * static_cast<double>(i % 8),
                 down = 1e-3 * static_cast<double>(i / 8);
    rays[i].direction = middle + core::Vec3d{across, down, 0.0} - rays[i].origin;
  }
  return rays;
}

struct Query {
  std::string name;
  std::function<Status(const Scene&, std::span<const Ray>, core::TraceOptions)> run;
};
std::vector<Query> KernelQueries() {
  return {
      {"closest",
       [](const Scene& scene, std::span<const Ray> rays, const core::TraceOptions& options) {
         std::vector<Hit> hits(rays.size());
         return core::TraceClosest(scene, rays, options, hits);
       }},
      {"any",
       [](const Scene& scene, std::span<const Ray> rays, const core::TraceOptions& options) {
         std::vector<std::uint8_t> occluded(rays.size());
         return core::TraceAny(scene, rays, options, occluded);
       }},
  };
}
std::vector<Query> OtherQueries() {
  return {
      {"costly",
       [](const Scene& scene, std::span<const Ray> rays, const core::TraceOptions& options) {
         std::vector<Hit> hits(rays.size());
         std::vector<core::TraceCost> costs(rays.size());
         return core::TraceCostly(scene, rays, options, hits, costs);
       }},
      {"count",
       [](const Scene& scene, std::span<const Ray> rays, const core::TraceOptions& options) {
         std::vector<std::uint32_t> counts(rays.size());
         return core::TraceCount(scene, rays, options, counts);
       }},
      {"all",
       [](const Scene& scene, std::span<const Ray> rays, const core::TraceOptions& options) {
         return test::StatusOf(core::TraceAll(scene, rays, options, 1 << 20));
       }},
  };
}

TEST(CancelledTrace, EndsWithinOneExactRayThroughTheApexOfAFan) {
  const Scene scene = test::MakeScene(Fan(100000), BuildKind::kBox);
  const std::vector<Ray> rays(4, ThroughApex());
  for (const KernelKind kernel : core::kAllKernelKinds) {
    core::TraceOptions options{Precision::kExact, {}, kernel};
    ExpectPrompt(test::CancelDuring(milliseconds(30),
                                    [&](const CancelToken& token) {
                                      options.cancel = token;
                                      std::vector<Hit> hits(rays.size());
                                      return core::TraceClosest(scene, std::span(rays), options,
                                                                hits);
                                    }),
                 std::string(Name(kernel)));
  }
  for (const Query& query : OtherQueries()) {
    ExpectPrompt(test::CancelDuring(milliseconds(30),
                                    [&](const CancelToken& token) {
                                      return query.run(scene, rays, {Precision::kExact, token});
                                    }),
                 query.name);
  }
}

TEST(CancelledTrace, EndsAmongExactRaysFromFarAway) {
  const Scene scene = test::MakeScene(test::Soup(60000, 0.02, 1), BuildKind::kKdSah);
  Ray ray;
  ray.origin = core::Vec3d{0.3, 0.5, 0.7} * 1e16;
  ray.direction = {-0.3, -0.5, -0.7};
  const std::vector<Ray> rays(4, ray);
  for (const std::vector<Query>& queries : {KernelQueries(), OtherQueries()}) {
    for (const Query& query : queries) {
      if (query.name == "costly") continue;  // builds its tree first: tests of builds look at that
      ExpectPrompt(
          test::CancelDuring(
              milliseconds(30),
              [&](const CancelToken& token) {
                // Again, since the rays take less than that.
                for (;;) {
                  const core::Status status = query.run(scene, rays, {Precision::kExact, token});
                  if (!status.ok()) return status;
                }
              }),
          query.name);
    }
  }
}

TEST(CancelledTrace, EndsWithinAFullLeafInEveryKernelAndPrecision) {
  // All in one leaf, all hit by every ray.
  const Scene scene = test::MakeScene(test::Coincident(1 << 20), BuildKind::kBox);
  std::vector<Ray> rays = Beam(scene, 64);
  // For "any" every triangle is beyond the end of the ray.
  std::vector<Ray> short_rays = rays;
  for (Ray& ray : short_rays) ray.t_max = 0.99;
  for (const Precision precision : core::kAllPrecisions) {
    for (const KernelKind kernel : core::kAllKernelKinds) {
      for (const Query& query : KernelQueries()) {
        const bool any = query.name == "any";
        ExpectPrompt(
            test::CancelDuring(
                milliseconds(2),
                [&](const CancelToken& token) {
                  // Again and again, so that the cancellation meets it at work.
                  Status status;
                  while (status.ok()) {
                    status = query.run(scene, any ? short_rays : rays, {precision, token, kernel});
                  }
                  return status;
                }),
            query.name + " by " + std::string(Name(kernel)) + " in " +
                std::string(Name(precision)));
      }
    }
    ExpectPrompt(test::CancelDuring(milliseconds(2),
                                    [&](const CancelToken& token) {
                                      return OtherQueries()[0].run(scene, rays, {precision, token});
                                    }),
                 "costly in " + std::string(Name(precision)));
  }
}

TEST(CancelledTrace, SortsCrossingsThatTieWithPolls) {
  // Every pair of crossings ties in the rounded t: each comparison takes integers.
  const Scene scene = test::MakeScene(test::Coincident(20000), BuildKind::kBox);
  const std::vector<Ray> rays = Beam(scene, 64);
  ExpectPrompt(
      test::CancelDuring(milliseconds(100),
                         [&](const CancelToken& token) {
                           return test::StatusOf(core::TraceAll(
                               scene, std::span(rays), {Precision::kExact, token}, 1 << 20));
                         }),
      "all");
}

TEST(CancelledTrace, AnswersFullyOrNotAtAllWheneverItIsCancelled) {
  const Scene scene = test::MakeScene(Fan(300), BuildKind::kKdSah);
  std::vector<Ray> rays(200, ThroughApex());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    rays[i].origin.x += 1e-3 * static_cast<double>(i % 7);
    rays[i].origin.y += 1e-3 * static_cast<double>(i % 11);
  }
  std::vector<Hit> expected(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    expected[i] = core::ClosestHit(scene, rays[i], Precision::kExact);
  }
  for (const KernelKind kernel : core::kAllKernelKinds) {
    bool completed = false;
    int cancelled = 0;
    for (std::uint64_t look = 1; !completed; look += 1 + look / 8) {
      std::vector<Hit> hits(rays.size());
      const Status status =
          core::TraceClosest(scene, std::span<const Ray>(rays),
                             {Precision::kExact, test::CancelledAtLook(look), kernel}, hits);
      if (status.ok()) {
        completed = true;
        EXPECT_EQ(hits, expected) << Name(kernel);
      } else {
        ++cancelled;
        ASSERT_EQ(status.error().code, ErrorCode::kCancelled);
      }
    }
    EXPECT_GT(cancelled, 3) << Name(kernel);
  }
}

TEST(CancelledTradeoff, LookingForAPointInsideEndsWithinTheRaysOfOneTry) {
  // Two stacks of equal triangles: each ray meets all of one, and every point between them has a
  // crossing on both sides.
  core::MeshData stacks;
  for (const double z : {0.0, 1.0}) {
    const auto first = static_cast<std::uint32_t>(stacks.vertices.size());
    for (const core::Vec3d& p :
         {core::Vec3d{-90, -70, z}, core::Vec3d{90, -70, z}, core::Vec3d{0, 100, z}}) {
      stacks.vertices.push_back(p);
    }
    stacks.triangles.insert(stacks.triangles.end(), 400'000 * test::CancelScale(),
                            {first, first + 1, first + 2});
  }
  const Scene scene = test::MakeScene(stacks, BuildKind::kBox);
  for (const milliseconds after : {milliseconds(20), milliseconds(150)}) {
    ExpectPrompt(test::CancelDuring(after,
                                    [&](const CancelToken& token) {
                                      return test::StatusOf(
                                          core::MakeAimedRays(scene, true, 1000, 1, token));
                                    }),
                 "MakeAimedRays after " + std::to_string(after.count()) + " ms");
  }
}

}  // namespace
}  // namespace kdray
