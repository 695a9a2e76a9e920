// SPDX-License-Identifier: Apache-2.0
#include "core/tradeoff/ray_sets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <span>
#include <utility>

#include "core/base/cancel_poll.h"
#include "core/trace/trace.h"

namespace kdray::core {
namespace {

constexpr std::size_t kOrigins = 64;
constexpr std::size_t kTriesPerOrigin = 32;
constexpr std::size_t kMaxCrossings = 256;
// Work of a try to find an origin, without its rays, and of making a ray (CancelPoll).
constexpr std::uint64_t kTryWork = 4096;
constexpr std::uint64_t kRayWork = 256;

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  /// In [0, 1); the same on every machine, unlike std::uniform_real_distribution.
  double Unit() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  std::size_t Below(std::size_t end) { return static_cast<std::size_t>(engine_() % end); }
  /// Uniform on the unit sphere (Archimedes: the height is uniform).
  Vec3d Direction() {
    const double z = 2 * Unit() - 1;
    const double angle = 2 * 3.14159265358979323846 * Unit();
    const double r = std::sqrt(std::max(0.0, 1 - z * z));
    return {r * std::cos(angle), r * std::sin(angle), z};
  }
  Vec3d PointIn(const Bounds3d& bounds) {
    const Vec3d e = bounds.Extent();
    return bounds.min + Vec3d{e.x * Unit(), e.y * Unit(), e.z * Unit()};
  }

 private:
  std::mt19937_64 engine_;
};

// A ray from `origin` towards `target`; in any direction if the two are equal.
Ray RayTowards(const Vec3d& origin, const Vec3d& target, Random* random) {
  Ray ray;
  ray.origin = origin;
  ray.direction = target - origin;
  if (!IsValid(ray)) ray.direction = random->Direction();
  return ray;
}

// From a point of a sphere around the bounds to a point within them.
Ray RayFromOutside(const Bounds3d& bounds, Random* random) {
  const Vec3d origin = bounds.Center() + random->Direction() * Length(bounds.Extent());
  return RayTowards(origin, random->PointIn(bounds), random);
}

// Every loop over rays ends early once the poll has stopped; MakeAimedRays checks it at the end.
class Aim {
 public:
  Aim(const Scene& scene, std::uint64_t seed, const CancelToken& cancel, CancelPoll* poll)
      : scene_(scene), mesh_(*scene.mesh), random_(seed), cancel_(cancel), poll_(*poll) {}

  struct Origin {
    Vec3d point;
    std::optional<int> plane;  // the axis on which the point has a vertex's coordinate
  };

  /// Empty if no point was found.
  std::vector<Origin> OriginsInside() {
    std::vector<Origin> origins;
    for (std::size_t i = 0; i < kOrigins * kTriesPerOrigin && origins.size() < kOrigins; ++i) {
      if (poll_.Spend(kTryWork)) break;
      // Every attempt costs some rays; after this many without success, more are unlikely to
      // succeed.
      if (origins.empty() && i > 4 * kOrigins) break;
      std::optional<Vec3d> point = BetweenSurfaces();
      if (!point) continue;
      std::optional<int> plane;
      if (origins.size() % 2 == 1) plane = MoveIntoPlane(&*point);
      if (IsInside(*point)) origins.push_back({*point, plane});
    }
    return origins;
  }

  std::vector<Origin> OriginsAnywhere() {
    std::vector<Origin> origins;
    // Slightly larger than the bounds, which may be flat.
    Bounds3d bounds = mesh_.bounds();
    const double side = 0.25 * LongestSide();
    bounds.min = bounds.min - Vec3d{side, side, side};
    bounds.max = bounds.max + Vec3d{side, side, side};
    for (std::size_t i = 0; i < kOrigins; ++i) {
      if (poll_.Spend(kTryWork)) break;
      Origin origin{random_.PointIn(bounds), std::nullopt};
      if (i % 2 == 1) {
        Origin moved = origin;
        moved.plane = MoveIntoPlane(&moved.point);
        if (IsClear(moved.point)) origin = moved;
      }
      origins.push_back(origin);
    }
    return origins;
  }

  Ray RayFrom(const Origin& origin, std::size_t i) {
    if (i % 4 == 2) return RayTowards(origin.point, PointOnEdge(), &random_);
    Vec3d vertex = Corner(random_.Below(mesh_.triangle_count()), random_.Below(3));
    if (i % 4 == 3 && origin.plane) vertex[*origin.plane] = origin.point[*origin.plane];
    return RayTowards(origin.point, vertex, &random_);
  }

 private:
  Hit Closest(const Ray& ray) { return ClosestHit(scene_, ray, Precision::kExact, &poll_); }

  /// The first hit with a larger t than `t`.
  Hit HitAfter(Ray ray, double t) {
    ray.t_min = std::nextafter(t, std::numeric_limits<double>::infinity());
    return Closest(ray);
  }

  Vec3d Corner(std::size_t triangle, std::size_t corner) const {
    return mesh_.frame().ToWorld(
        mesh_.LocalCorner(static_cast<PrimitiveId>(triangle), static_cast<int>(corner)));
  }
  Vec3d PointOnEdge() {
    const std::size_t triangle = random_.Below(mesh_.triangle_count());
    const std::size_t corner = random_.Below(3);
    const Vec3d a = Corner(triangle, corner), b = Corner(triangle, (corner + 1) % 3);
    const double weight = random_.Unit();
    return a * weight + b * (1 - weight);
  }

  /// The middle between the first two surfaces that a random ray from outside crosses.
  std::optional<Vec3d> BetweenSurfaces() {
    const Ray ray = RayFromOutside(mesh_.bounds(), &random_);
    const Hit first = Closest(ray);
    if (!first.IsHit()) return std::nullopt;
    const Hit second = HitAfter(ray, first.t);
    if (!second.IsHit()) return std::nullopt;
    return ray.origin + ray.direction * (0.5 * first.t + 0.5 * second.t);
  }

  /// Sets the point's coordinate on a random axis to that of the nearest of some vertices.
  int MoveIntoPlane(Vec3d* point) {
    const int axis = static_cast<int>(random_.Below(3));
    double nearest = std::numeric_limits<double>::infinity();
    const double old = (*point)[axis];
    for (int i = 0; i < 64; ++i) {
      const double c = Corner(random_.Below(mesh_.triangle_count()), random_.Below(3))[axis];
      if (std::fabs(c - old) < std::fabs(nearest - old)) nearest = c;
    }
    (*point)[axis] = nearest;
    return axis;
  }

  // For an origin on the surface, rounding decides whether t is negative, which says nothing about
  // the mesh.
  bool IsClear(const Vec3d& point) {
    Ray ray;
    ray.origin = point;
    const double margin = Margin();
    for (int i = 0; i < 6; ++i) {
      ray.direction = random_.Direction();
      const Hit hit = Closest(ray);
      if (hit.IsHit() && hit.t < margin) return false;
    }
    return true;
  }

  // Three random lines through the point must cross the mesh an odd number of times on both sides,
  // and nowhere nearer than the margin: precisions that round vertices move the surface by 2^-24 of
  // the mesh's size, and the point must be inside for them too.
  bool IsInside(const Vec3d& point) {
    for (int i = 0; i < 3; ++i) {
      std::array<Ray, 2> opposite;
      opposite[0].direction = random_.Direction();
      opposite[1].direction = opposite[0].direction * -1.0;
      for (Ray& ray : opposite) ray.origin = point;
      const auto crossings = TraceAll(scene_, std::span<const Ray>(opposite),
                                      {Precision::kExact, cancel_}, kMaxCrossings);
      if (!crossings.ok() || !crossings->truncated.empty()) return false;
      for (std::size_t ray = 0; ray < opposite.size(); ++ray) {
        const std::size_t first = crossings->first[ray];
        const std::size_t count = crossings->first[ray + 1] - first;
        if (count % 2 == 0 || crossings->hits[first].t < Margin()) return false;
      }
    }
    return true;
  }

  double Margin() const { return 0x1p-14 * LongestSide(); }
  double LongestSide() const {
    const Vec3d extent = mesh_.bounds().Extent();
    return std::max({extent.x, extent.y, extent.z});
  }

  const Scene& scene_;
  const TriangleMesh& mesh_;
  Random random_;
  const CancelToken& cancel_;
  CancelPoll& poll_;
};

}  // namespace

std::vector<Ray> RandomRays(const TriangleMesh& mesh, std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<Ray> rays(count);
  for (Ray& ray : rays) ray = RayFromOutside(mesh.bounds(), &random);
  return rays;
}

Result<AimedRays> MakeAimedRays(const Scene& scene, bool closed, std::size_t count,
                                std::uint64_t seed, const CancelToken& cancel) {
  CancelPoll poll(cancel);
  Aim aim(scene, seed, cancel, &poll);
  std::vector<Aim::Origin> origins;
  if (closed) origins = aim.OriginsInside();
  AimedRays aimed;
  aimed.from_inside = !origins.empty();
  if (origins.empty()) origins = aim.OriginsAnywhere();
  if (poll.stopped()) return poll.ToError();
  aimed.rays.resize(count);
  // Four rays with different aims from each origin in turn.
  for (std::size_t i = 0; i < count; ++i) {
    if (poll.Spend(kRayWork)) return poll.ToError();
    aimed.rays[i] = aim.RayFrom(origins[i / 4 % origins.size()], i);
  }
  return aimed;
}

}  // namespace kdray::core
