// SPDX-License-Identifier: Apache-2.0
// The rays on which kdray and Embree differ, one by one: those that trace_bench.cc counts, of the
// same meshes and classes, held against `exact`. Both get the same floats. Writes CSV to standard
// output, a row a ray and precision; tests/bench/mismatches runs it.
//
// Options: --mesh NAME (may be repeated), --side PIXELS.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "core/base/parallel.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "tests/bench/scenes.h"

namespace kdray::bench {
namespace {

using core::Hit;
using core::MeshData;
using core::Precision;
using core::PrimitiveId;
using core::Ray;
using core::RayF;
using core::Vec3d;

constexpr double kMiss = std::numeric_limits<double>::infinity();

/// What one ray meets first, by one of the sides.
struct Answer {
  double t = kMiss;
  PrimitiveId triangle = core::kNoPrimitive;
};

class Embree {
 public:
  explicit Embree(const MeshData& data) : scene_(data, RTC_BUILD_QUALITY_MEDIUM, true, 1) {}

  Answer Closest(const RayF& ray) const {
    const FlushDenormals flush;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRayHit query{};
    query.ray = ToEmbree(ray);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene_.scene(), &context, &query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
    return {static_cast<double>(query.ray.tfar), query.hit.primID};
  }
  bool Any(const RayF& ray) const {
    const FlushDenormals flush;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRay query = ToEmbree(ray);
    rtcOccluded1(scene_.scene(), &context, &query);
    return query.tfar < 0;
  }

 private:
  static RTCRay ToEmbree(const RayF& ray) {
    return {ray.origin.x,
            ray.origin.y,
            ray.origin.z,
            ray.t_min,
            ray.direction.x,
            ray.direction.y,
            ray.direction.z,
            0,
            ray.t_max,
            0xffffffffu,
            0,
            0};
  }
  EmbreeScene scene_;
};

// ---- One ray and one triangle ----

/// A plane across a ray: the ray is its origin.
class AcrossRay {
 public:
  explicit AcrossRay(const RayF& ray)
      : origin_(ray.origin), along_(core::Normalized(Vec3d(ray.direction))) {
    const Vec3d helper = std::fabs(along_.x) < 0.6 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
    first_ = core::Normalized(core::Cross(along_, helper));
    second_ = core::Cross(along_, first_);
  }
  struct Point {
    double x, y;
  };
  Point operator()(const Vec3d& p) const {
    return {core::Dot(first_, p - origin_), core::Dot(second_, p - origin_)};
  }
  const Vec3d& along() const { return along_; }

 private:
  Vec3d origin_, along_, first_, second_;
};

/// The line a-b and where c is: left (positive) or right of it.
double Side(const AcrossRay::Point& a, const AcrossRay::Point& b, const AcrossRay::Point& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

double DistanceToSegment(const AcrossRay::Point& a, const AcrossRay::Point& b) {
  const double x = b.x - a.x, y = b.y - a.y;
  const double square = x * x + y * y;
  const double w = square > 0 ? std::clamp(-(a.x * x + a.y * y) / square, 0.0, 1.0) : 0.0;
  return std::hypot(a.x + w * x, a.y + w * y);
}

/// How the ray passes a triangle's nearest edge.
struct Passing {
  double distance = 0;    ///< of the ray's line from the edge
  const char* edge = "";  ///< what the edge is, as the ray sees it
  double cosine = 0;      ///< |cos| between the ray and the triangle's normal
};

Passing Pass(const MeshData& data, const RayF& ray, PrimitiveId id) {
  const AcrossRay across(ray);
  const core::TriangleIndices& t = data.triangles[id];
  const auto corner = [&](std::size_t k) -> const Vec3d& { return data.vertices[t[k % 3]]; };
  Passing passing;
  passing.distance = std::numeric_limits<double>::infinity();
  std::size_t nearest = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double distance = DistanceToSegment(across(corner(k)), across(corner(k + 1)));
    if (distance < passing.distance) {
      passing.distance = distance;
      nearest = k;
    }
  }
  const Vec3d normal = core::Normalized(core::Cross(corner(1) - corner(0), corner(2) - corner(0)));
  passing.cosine = std::fabs(core::Dot(normal, across.along()));

  // Who shares the edge, by place: on the other side of it, the surface goes on; on the same side,
  // it turns back.
  const Vec3d &a = corner(nearest), &b = corner(nearest + 1);
  const double own_side = Side(across(a), across(b), across(corner(nearest + 2)));
  passing.edge = "border";
  for (PrimitiveId other = 0; other < data.triangles.size(); ++other) {
    if (other == id) continue;
    const Vec3d* third = nullptr;
    int shared = 0;
    for (const std::uint32_t v : data.triangles[other]) {
      const Vec3d& p = data.vertices[v];
      if (p == a || p == b) {
        ++shared;
      } else {
        third = &p;
      }
    }
    if (shared != 2 || third == nullptr) continue;
    if (Side(across(a), across(b), across(*third)) * own_side < 0) {
      passing.edge = "inner";
      break;
    }
    passing.edge = "outline";
  }
  return passing;
}

// ---- One mesh ----

/// What is said of one ray: who differs from `exact`, by a triangle too few or too many, and how
/// the ray passes that triangle.
struct Explanation {
  const char* wrong;
  const char* what;
  Answer ours, exact, theirs;
  Passing passing;
};

Explanation Explain(Precision precision, const core::Scene& scene, const MeshData& data,
                    const Embree& embree, const RayF& ray) {
  const Ray wide{Vec3d(ray.origin), static_cast<double>(ray.t_min), Vec3d(ray.direction),
                 static_cast<double>(ray.t_max)};
  const auto ask = [&](Precision how) {
    const Hit hit = core::ClosestHit(scene, wide, how);
    return Answer{hit.t, hit.primitive_id};
  };
  const Answer ours = ask(precision), exact = ask(Precision::kExact), theirs = embree.Closest(ray);
  const bool ours_wrong = IsMismatch(ours.t, exact.t);
  const bool theirs_wrong = IsMismatch(theirs.t, exact.t);
  const char* const wrong = ours_wrong && theirs_wrong ? "both"
                            : ours_wrong               ? "kdray"
                            : theirs_wrong             ? "Embree"
                                                       : "neither";
  // The triangle on which the wrong side and `exact` differ is the nearer of the two.
  const Answer& other = ours_wrong ? ours : theirs;
  const bool lost = exact.t < other.t;
  const PrimitiveId disputed = lost ? exact.triangle : other.triangle;
  return {wrong,  lost ? "lost" : "extra",
          ours,   exact,
          theirs, disputed == core::kNoPrimitive ? Passing{} : Pass(data, ray, disputed)};
}

void RunMesh(const std::string& name, int side) {
  std::fprintf(stderr, "%s\n", name.c_str());
  const BenchMesh bench = LoadBenchMesh(name);
  const auto mesh =
      std::make_shared<const core::TriangleMesh>(core::TriangleMesh::Create(bench.data).value());
  const auto tree =
      std::make_shared<const core::Tree>(core::BuildTree(*mesh, core::BuildKind::kKdSah).value());
  const core::Scene scene{mesh, tree};
  const Embree embree(bench.data);
  for (const BenchRays& batch : MakeRayClasses(*mesh, bench, side)) {
    const std::span<const RayF> rays(batch.rays);
    std::vector<double> theirs(rays.size());
    for (std::size_t i = 0; i < rays.size(); ++i) {
      theirs[i] = !batch.any ? embree.Closest(rays[i]).t : embree.Any(rays[i]) ? 0 : kMiss;
    }
    for (const Precision precision : core::kAllPrecisions) {
      const core::TraceOptions options{precision, {}};
      std::vector<Hit> hits(batch.any ? 0 : rays.size());
      std::vector<std::uint8_t> occluded(batch.any ? rays.size() : 0);
      const core::Status status = batch.any ? core::TraceAny(scene, rays, options, occluded)
                                            : core::TraceClosest(scene, rays, options, hits);
      if (!status.ok()) std::exit(1);
      for (std::size_t i = 0; i < rays.size(); ++i) {
        const double ours = !batch.any ? hits[i].t : occluded[i] != 0 ? 0 : kMiss;
        if (!IsMismatch(ours, theirs[i])) continue;
        const Explanation e = Explain(precision, scene, bench.data, embree, rays[i]);
        std::printf("%s,\"%s\",%zu,%s,%s,%s,%s,%.9g,%.9g,%.9g,%.4g,%.4g\n", name.c_str(),
                    batch.name.c_str(), rays.size(), std::string(core::Name(precision)).c_str(),
                    e.wrong, e.what, e.passing.edge, e.ours.t, e.exact.t, e.theirs.t,
                    std::ldexp(e.passing.distance, 24 - mesh->frame().exponent), e.passing.cosine);
      }
    }
  }
}

int Main(int argc, char** argv) {
  std::vector<std::string> meshes;
  int side = 512;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i];
    if (i + 1 == argc || (name != "--mesh" && name != "--side")) {
      std::fprintf(stderr, "options: --mesh NAME, --side PIXELS\n");
      return 2;
    }
    if (name == "--mesh") meshes.emplace_back(argv[i + 1]);
    if (name == "--side") side = std::atoi(argv[i + 1]) / 8 * 8;
  }
  if (side < 8) {
    std::fprintf(stderr, "--side is at least 8\n");
    return 2;
  }
  if (meshes.empty()) meshes = {"bunny_69k", "igea_268k", "classroom_111k", "scan_1m"};
  std::printf("mesh,rays,of,precision,wrong,what,edge,t,t_exact,t_embree,ulps,cosine\n");
  core::Arena arena(static_cast<int>(std::max(1u, std::thread::hardware_concurrency())));
  for (const std::string& mesh : meshes) arena.Run([&] { RunMesh(mesh, side); });
  return 0;
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) { return kdray::bench::Main(argc, argv); }
