// SPDX-License-Identifier: Apache-2.0
#include "tests/property/aimed_run.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "core/geometry/local_ray.h"
#include "core/trace/trace.h"
#include "tests/property/scenes.h"

namespace kdray::test {

using namespace core;

namespace {

bool ShareAnEdge(const MeshData& data, PrimitiveId a, PrimitiveId b) {
  int shared = 0;  // by place: formats such as STL repeat their vertices
  for (const std::uint32_t v : data.triangles[a]) {
    for (const std::uint32_t w : data.triangles[b])
      shared += data.vertices[v] == data.vertices[w] ? 1 : 0;
  }
  return shared >= 2;
}

/// A triangle as the ray sees it. Lengths are in units of the mesh's frame.
struct Seen {
  double cosine;  ///< |cos| between the ray and the normal
  double border;  ///< from the hit to the nearest edge, in the triangle's plane
};
Seen See(const ClosedMesh& mesh, const Ray& ray, const Hit& hit) {
  const MeshFrame& frame = mesh.scene.mesh->frame();
  const TriangleIndices& t = mesh.data.triangles[hit.primitive_id];
  std::array<Vec3d, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) corners[k] = frame.ToLocal(mesh.data.vertices[t[k]]);
  const Vec3d normal = Cross(corners[1] - corners[0], corners[2] - corners[0]);
  const double area = Length(normal);
  const double weights[3] = {1 - hit.u - hit.v, hit.u, hit.v};
  double border = 1;
  for (std::size_t k = 0; k < 3; ++k) {
    const double edge = Length(corners[(k + 1) % 3] - corners[(k + 2) % 3]);
    border = std::min(border, weights[k] * area / edge);
  }
  return {std::fabs(Dot(NormalizedAtAnyScale(normal), NormalizedAtAnyScale(ray.direction))),
          border};
}

/// What the two forms may differ by: e of the bound, and how far rounding may move the ray.
struct Allowed {
  double e, pad;
};
constexpr Allowed kWatertightAllowed{1e-6, kFloatPad};
constexpr Allowed kDoubleAllowed{1e-14, kDoublePad};

void Compare(const ClosedMesh& mesh, const Allowed& allowed, const std::vector<Ray>& rays,
             const std::vector<Hit>& hits, const std::vector<Hit>& exact, Agreement* agreement) {
  const double extent = MaxAbs(mesh.scene.mesh->bounds().Extent());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Hit &hit = hits[i], &truth = exact[i];
    if (!hit.IsHit() || !truth.IsHit()) continue;  // a leak, counted as such
    const double longest = MaxAbs(rays[i].direction);
    const double length = longest * Length(rays[i].direction * (1 / longest));
    const double bound =
        allowed.e * (std::fabs(hit.t) + extent / length) / See(mesh, rays[i], hit).cosine;
    const double difference = std::fabs(hit.t - truth.t) / bound;
    if (difference <= 1) {
      agreement->largest = std::max(agreement->largest, difference);
      ++(hit.primitive_id == truth.primitive_id                         ? agreement->same
         : ShareAnEdge(mesh.data, hit.primitive_id, truth.primitive_id) ? agreement->neighbours
                                                                        : agreement->corners);
      continue;
    }
    const Seen nearer = See(mesh, rays[i], hit.t < truth.t ? hit : truth);
    // A ray that is moved by a pad a component moves its hit by that over the cosine.
    const bool is_fold = hit.primitive_id != truth.primitive_id &&
                         nearer.border * nearer.cosine <= std::sqrt(3.0) * allowed.pad;
    ++(is_fold ? agreement->folds : agreement->unexplained);
  }
}

void Add(Agreement* sum, const Agreement& other) {
  sum->same += other.same;
  sum->neighbours += other.neighbours;
  sum->corners += other.corners;
  sum->folds += other.folds;
  sum->unexplained += other.unexplained;
  sum->largest = std::max(sum->largest, other.largest);
}

}  // namespace

AimedRun& AimedRun::operator+=(const AimedRun& other) {
  rays += other.rays;
  for (std::size_t p = 0; p < leaks.size(); ++p) leaks[p] += other.leaks[p];
  Add(&watertight, other.watertight);
  Add(&doubled, other.doubled);
  return *this;
}

AimedRun RunAimed(const ClosedMesh& mesh, const RayFamily& family, std::size_t count,
                  std::mt19937_64& engine) {
  constexpr std::size_t kBlock = 100'000;  // bounds the memory of a long run
  AimedRun run;
  while (run.rays < count) {
    const std::vector<Ray> rays = family(mesh, std::min(kBlock, count - run.rays), engine);
    if (rays.empty()) break;
    run.rays += rays.size();
    std::array<std::vector<Hit>, kAllPrecisions.size()> hits;
    for (const Precision precision : kAllPrecisions) {
      const auto p = static_cast<std::size_t>(precision);
      hits[p].resize(rays.size());
      EXPECT_TRUE(
          TraceClosest(mesh.scene, std::span<const Ray>(rays), With(precision), hits[p]).ok());
      run.leaks[p] += static_cast<std::size_t>(
          std::count_if(hits[p].begin(), hits[p].end(), [](const Hit& h) { return !h.IsHit(); }));
    }
    const auto& exact = hits[static_cast<std::size_t>(Precision::kExact)];
    Compare(mesh, kWatertightAllowed, rays, hits[static_cast<std::size_t>(Precision::kWatertight)],
            exact, &run.watertight);
    Compare(mesh, kDoubleAllowed, rays, hits[static_cast<std::size_t>(Precision::kDouble)], exact,
            &run.doubled);
  }
  return run;
}

void ExpectTight(std::string_view family, std::string_view mesh, const AimedRun& run) {
  const std::string where = std::string(family) + ", " + std::string(mesh);
  for (const Precision precision : kAllPrecisions) {
    const std::size_t leaks = run.leaks[static_cast<std::size_t>(precision)];
    const auto rays = static_cast<double>(run.rays);
    char rate[32];
    if (leaks == 0) {
      std::snprintf(rate, sizeof(rate), "< %.1e", 3 / rays);  // with a confidence of 95 %
    } else {
      std::snprintf(rate, sizeof(rate), "%.1e", static_cast<double>(leaks) / rays);
    }
    std::printf("| %s | %s | %s | %zu | %zu | %s |", std::string(family).c_str(),
                std::string(mesh).c_str(), std::string(Name(precision)).c_str(), run.rays, leaks,
                rate);
    const Agreement* agreement = precision == Precision::kWatertight ? &run.watertight
                                 : precision == Precision::kDouble   ? &run.doubled
                                                                     : nullptr;
    if (agreement != nullptr) {
      std::printf(" %zu | %zu | %zu | %zu | %.3f |", agreement->same, agreement->neighbours,
                  agreement->corners, agreement->folds, agreement->largest);
      EXPECT_EQ(agreement->unexplained, 0u) << where << ", " << Name(precision);
    } else {
      std::printf(" | | | | |");
    }
    std::printf("\n");
    if (precision != Precision::kFast) {
      EXPECT_EQ(leaks, 0u) << where << ", " << Name(precision) << ", of " << run.rays;
    }
  }
}

}  // namespace kdray::test
