#include "core/trace/trace.h"

#include <atomic>
#include <cassert>

#include "core/base/parallel.h"
#include "core/trace/exact_test.h"
#include "core/trace/query.h"

namespace kdray::core {
namespace {

// A block is what one thread takes at a time; between chunks of it the clock is looked at. Tracing
// a chunk takes some 100 microseconds through a tree, so a cancelled request ends promptly even in
// a box of many triangles.
constexpr std::size_t kBlockRays = 4096;
constexpr std::size_t kChunkRays = 64;

/// Calls f(structure, corners, test tag) for the scene's structure, stored number type and
/// precision.
template <class Test>
struct TestTag {
  using Type = Test;
};

template <class F>
void Dispatch(const Scene& scene, Precision precision, const F& f) {
  std::visit(
      [&](const auto& structure) {
        scene.mesh->VisitVertices([&]<class Stored>(std::span<const Vec3<Stored>> vertices) {
          const auto with = [&]<class Test>(TestTag<Test> tag) {
            f(structure, Corners<typename Test::Number, Stored>(vertices, scene.mesh->triangles()),
              tag);
          };
          switch (precision) {
            case Precision::kFast:
              with(TestTag<FastTest>());
              return;
            case Precision::kWatertight:
              with(TestTag<WatertightTest<float>>());
              return;
            case Precision::kDouble:
              with(TestTag<WatertightTest<double>>());
              return;
            case Precision::kExact:
              with(TestTag<ExactTest>());
              return;
          }
        });
      },
      scene.tree->structure);
}

/// per_ray(structure, corners, tag, i, ray) for every ray of the batch, in parallel.
template <class PerRay>
Status ForEachRay(const Scene& scene, const RayBatch& rays, const TraceOptions& options,
                  const PerRay& per_ray) {
  std::atomic<bool> stopped{false};
  Dispatch(scene, options.precision, [&](const auto& structure, const auto& corners, auto tag) {
    ParallelFor(0, rays.size(), kBlockRays, [&](std::size_t first, std::size_t last) {
      for (std::size_t chunk = first; chunk < last; chunk += kChunkRays) {
        if (stopped.load(std::memory_order_relaxed)) return;
        if (options.cancel.ShouldStop()) {
          stopped.store(true, std::memory_order_relaxed);
          return;
        }
        const std::size_t end = std::min(last, chunk + kChunkRays);
        for (std::size_t i = chunk; i < end; ++i) per_ray(structure, corners, tag, i, rays[i]);
      }
    });
  });
  if (stopped) return options.cancel.ToError();
  return {};
}

Hit InvalidRow() {
  Hit hit;
  hit.t = std::numeric_limits<double>::quiet_NaN();
  return hit;
}

template <class Test, class Structure, class Corners, class Cost>
Hit ClosestOf(const Scene& scene, const Structure& structure, const Corners& corners,
              const Ray& ray, Cost cost) {
  if (!IsValid(ray)) return InvalidRow();
  const std::optional<LocalRay> local = MakeLocalRay(ray, scene.mesh->frame());
  if (!local) return Hit{};
  return FindClosest<Test>(structure, corners, *local, cost);
}

template <class Test, class Structure, class Corners>
bool AnyOf(const Scene& scene, const Structure& structure, const Corners& corners, const Ray& ray) {
  if (!IsValid(ray)) return false;
  const std::optional<LocalRay> local = MakeLocalRay(ray, scene.mesh->frame());
  return local && FindAny<Test>(structure, corners, *local);
}

}  // namespace

Status TraceClosest(const Scene& scene, RayBatch rays, const TraceOptions& options,
                    std::span<Hit> hits) {
  assert(hits.size() == rays.size());
  return ForEachRay(
      scene, rays, options,
      [&](const auto& structure, const auto& corners, auto tag, std::size_t i, const Ray& ray) {
        using Test = typename decltype(tag)::Type;
        hits[i] = ClosestOf<Test>(scene, structure, corners, ray, NoCost{});
      });
}

Status TraceAny(const Scene& scene, RayBatch rays, const TraceOptions& options,
                std::span<std::uint8_t> occluded) {
  assert(occluded.size() == rays.size());
  return ForEachRay(
      scene, rays, options,
      [&](const auto& structure, const auto& corners, auto tag, std::size_t i, const Ray& ray) {
        using Test = typename decltype(tag)::Type;
        occluded[i] = AnyOf<Test>(scene, structure, corners, ray) ? 1 : 0;
      });
}

Status TraceCostly(const Scene& scene, RayBatch rays, const TraceOptions& options,
                   std::span<Hit> hits, std::span<TraceCost> costs) {
  assert(hits.size() == rays.size() && costs.size() == rays.size());
  return ForEachRay(
      scene, rays, options,
      [&](const auto& structure, const auto& corners, auto tag, std::size_t i, const Ray& ray) {
        using Test = typename decltype(tag)::Type;
        costs[i] = {};
        hits[i] = ClosestOf<Test>(scene, structure, corners, ray, CountCost{&costs[i]});
      });
}

Hit ClosestHit(const Scene& scene, const Ray& ray, Precision precision) {
  Hit hit;
  Dispatch(scene, precision, [&](const auto& structure, const auto& corners, auto tag) {
    hit = ClosestOf<typename decltype(tag)::Type>(scene, structure, corners, ray, NoCost{});
  });
  return hit;
}

bool AnyHit(const Scene& scene, const Ray& ray, Precision precision) {
  bool found = false;
  Dispatch(scene, precision, [&](const auto& structure, const auto& corners, auto tag) {
    found = AnyOf<typename decltype(tag)::Type>(scene, structure, corners, ray);
  });
  return found;
}

}  // namespace kdray::core
