#include "core/trace/crossings.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <optional>
#include <variant>

#include "core/base/polled_sort.h"
#include "core/geometry/local_ray.h"
#include "core/intersect/closest_search.h"
#include "core/intersect/exact_intersection.h"
#include "core/trace/ray_chunks.h"

namespace kdray::core {
namespace {

struct Crossing {
  ExactIntersection::Hit hit;
  PrimitiveId id;
};
// Work (CancelPoll) of moving one crossing in a sort.
constexpr std::uint64_t kSortWork = 16;

/// All crossings of one ray within the caller's interval, in order of id; unspecified if the poll
/// stops. Scratch is reused.
template <class CornersOf>
void FindCrossings(const WideTree& tree, const CornersOf& corners, const LocalRay& ray,
                   const ExactIntersection& test, CancelPoll* poll,
                   std::vector<Crossing>* crossings) {
  crossings->clear();
  tree.Traverse(
      ray, test.pad(),
      [&](std::span<const PrimitiveId> leaf) {
        poll->Spend(leaf.size() * ExactIntersection::kWork);
        for (const PrimitiveId id : leaf) {
          const auto [a, b, c] = corners(id);
          ExactIntersection::Hit hit;
          if (test.Test(a, b, c, &hit) && test.OwnsCrossing(a, b, c, hit) &&
              test.IsInInterval(hit, id, corners)) {
            crossings->push_back({hit, id});
          }
        }
        return std::numeric_limits<double>::infinity();
      },
      [&] { return !poll->Spend(kNodeWork); });
  // A kd-tree may have a triangle in several leaves.
  PolledSort(std::span(*crossings), kSortWork, poll,
             [](const Crossing& a, const Crossing& b) { return a.id < b.id; });
  crossings->erase(std::unique(crossings->begin(), crossings->end(),
                               [](const Crossing& a, const Crossing& b) { return a.id == b.id; }),
                   crossings->end());
}

/// per_ray(i, test, corners, poll, crossings) for every ray of the batch, except invalid rays and
/// rays that miss [-2, 2]^3.
template <class PerRay>
Status ForEachRay(const Scene& scene, const RayBatch& rays, const CancelToken& cancel,
                  const PerRay& per_ray) {
  const auto with = [&](const auto& corners) {
    const auto trace = [&](std::size_t first, std::size_t last, CancelPoll* poll) {
      std::vector<Crossing> crossings;
      for (std::size_t i = first; i < last; ++i) {
        if (poll->Spend(kNodeWork)) return;
        const Ray ray = rays[i];
        if (!IsValid(ray)) continue;
        const std::optional<LocalRay> local = ExactIntersection::MakeRay(ray, scene.mesh->frame());
        if (!local) continue;
        const ExactIntersection test(*local);
        FindCrossings(scene.tree->wide, corners, *local, test, poll, &crossings);
        per_ray(i, test, corners, poll, crossings);
      }
    };
    return ForEachChunk(rays.size(), cancel, trace);
  };
  return scene.mesh->VisitVertices([&]<class Stored>(std::span<const Vec3<Stored>> vertices) {
    return with(Corners<double, Stored>(vertices, scene.mesh->triangles()));
  });
}

}  // namespace

Status TraceCount(const Scene& scene, RayBatch rays, const CancelToken& cancel,
                  std::span<std::uint32_t> counts) {
  assert(counts.size() == rays.size());
  std::fill(counts.begin(), counts.end(), 0u);
  return ForEachRay(scene, rays, cancel,
                    [&](std::size_t i, const ExactIntersection&, const auto&, CancelPoll*,
                        const std::vector<Crossing>& crossings) {
                      counts[i] = static_cast<std::uint32_t>(crossings.size());
                    });
}

Result<Crossings> TraceAll(const Scene& scene, RayBatch rays, std::size_t max_hits,
                           const CancelToken& cancel) {
  // Each chunk fills its own list, so threads do not conflict; the lists are joined in order.
  std::vector<std::vector<Hit>> chunks((rays.size() + kChunkRays - 1) / kChunkRays);
  std::vector<std::size_t> kept(rays.size());
  std::vector<std::uint8_t> cut(rays.size());
  const Status status = ForEachRay(
      scene, rays, cancel,
      [&](std::size_t i, const ExactIntersection& test, const auto& corners, CancelPoll* poll,
          std::vector<Crossing>& crossings) {
        const auto is_closer = [&](const Crossing& a, const Crossing& b) {
          return test.IsCloser(a.hit, a.id, b.hit, b.id, corners);
        };
        kept[i] = std::min(max_hits, crossings.size());
        cut[i] = crossings.size() > max_hits;
        PolledPartialSort(std::span(crossings), kept[i], ExactIntersection::kWork, poll, is_closer);
        std::vector<Hit>& hits = chunks[i / kChunkRays];
        for (const Crossing& c : std::span(crossings).first(kept[i]))
          hits.push_back(test.Finish(c.hit, c.id, corners));
      });
  if (!status.ok()) return status.error();

  Crossings all;
  all.first.reserve(rays.size() + 1);
  all.first.push_back(0);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    all.first.push_back(all.first.back() + kept[i]);
    if (cut[i] != 0) all.truncated.push_back(i);
  }
  all.hits.reserve(all.first.back());
  for (std::vector<Hit>& hits : chunks) {
    all.hits.insert(all.hits.end(), hits.begin(), hits.end());
    hits = {};
  }
  return all;
}

}  // namespace kdray::core
