// SPDX-License-Identifier: Apache-2.0
// The queries `count` and `all` beside Embree's way to the same answer: rtcIntersect with a filter
// function that takes each hit down and rejects it, so the traversal goes on. Random rays, the same
// for both sides, in turn in one process. Then the parity of counts in `exact`: on a closed mesh,
// the numbers of crossings on the two sides of a point are both odd or both even. Writes CSV to
// standard output; tests/bench/hits runs it.
//
// Options: --mesh NAME (may be repeated), --build NAME (kd-sah), --runs N, --rays N, --quick (a
// tenth of the rays).
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/geometry/mesh_health.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "tests/bench/scenes.h"

namespace kdray::bench {
namespace {

using core::Hit;
using core::Precision;
using core::RayF;
using core::Vec3d;
using core::Vec3f;

constexpr std::size_t kParityPoints = 500'000;

struct Options {
  std::vector<std::string> meshes;
  int runs = 5;
  std::size_t rays = 1'000'000;
  core::BuildKind build = core::BuildKind::kKdSah;
};

double ThreadSeconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::vector<RayF> RandomRays(const core::TriangleMesh& mesh, std::size_t count) {
  std::mt19937_64 engine(12);
  std::uniform_real_distribution<double> uniform(0, 1);
  const Vec3d least = mesh.bounds().min, extent = mesh.bounds().Extent();
  const auto point = [&] {
    const double x = uniform(engine), y = uniform(engine), z = uniform(engine);
    return Vec3f(least + Vec3d{extent.x * x, extent.y * y, extent.z * z});
  };
  std::vector<RayF> rays;
  while (rays.size() < count) {
    const Vec3f from = point();
    rays.push_back({from, 0, point() - from, std::numeric_limits<float>::infinity()});
    if (!core::IsValid(rays.back())) rays.pop_back();
  }
  return rays;
}

/// What a hit is on both sides: 16 bytes of Embree's, as its filter function sees them.
struct EmbreeHit {
  float t, u, v;
  unsigned triangle;
};

/// Embree's rays, and the hits that the filter function took down. Lists of rays are not sorted.
class EmbreeHits {
 public:
  EmbreeHits(const core::MeshData& data, bool packets)
      : scene_(data, RTC_BUILD_QUALITY_MEDIUM, /*robust=*/true, 1), packets_(packets) {
    const RTCGeometry geometry = rtcGetGeometry(scene_.scene(), 0);
    rtcSetGeometryUserData(geometry, this);
    rtcSetGeometryIntersectFilterFunction(geometry, [](const RTCFilterFunctionNArguments* args) {
      static_cast<EmbreeHits*>(args->geometryUserPtr)->Take(*args);
    });
    rtcCommitGeometry(geometry);
    rtcCommitScene(scene_.scene());
  }

  /// Seconds for all rays.
  double Run(const std::vector<RayF>& rays, bool list) {
    list_ = list;
    counts_.assign(rays.size(), 0);
    hits_.clear();
    const double start = ThreadSeconds();
    {
      const FlushDenormals flush;
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      if (packets_) {
        for (std::size_t i = 0; i < rays.size(); i += 16) TracePacket(rays, i, &context);
      } else {
        for (std::size_t i = 0; i < rays.size(); ++i) TraceOne(rays[i], i, &context);
      }
    }
    return ThreadSeconds() - start;
  }
  std::uint64_t hits() const {
    std::uint64_t sum = 0;
    for (const std::uint32_t count : counts_) sum += count;
    return sum;
  }

 private:
  void Take(const RTCFilterFunctionNArguments& args) {
    for (unsigned k = 0; k < args.N; ++k) {
      if (args.valid[k] != -1) continue;
      args.valid[k] = 0;
      const unsigned ray = RTCRayN_id(args.ray, args.N, k);
      ++counts_[ray];
      if (list_) {
        hits_.push_back({{RTCRayN_tfar(args.ray, args.N, k), RTCHitN_u(args.hit, args.N, k),
                          RTCHitN_v(args.hit, args.N, k), RTCHitN_primID(args.hit, args.N, k)},
                         ray});
      }
    }
  }
  void TraceOne(const RayF& ray, std::size_t i, RTCIntersectContext* context) {
    RTCRayHit q;
    q.ray = {ray.origin.x,
             ray.origin.y,
             ray.origin.z,
             ray.t_min,
             ray.direction.x,
             ray.direction.y,
             ray.direction.z,
             0,
             ray.t_max,
             0xffffffffu,
             static_cast<unsigned>(i),
             0};
    q.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    q.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene_.scene(), context, &q);
  }
  void TracePacket(const std::vector<RayF>& rays, std::size_t first, RTCIntersectContext* context) {
    RTCRayHit16 p;
    alignas(64) int valid[16];
    for (std::size_t k = 0; k < 16; ++k) {
      valid[k] = first + k < rays.size() ? -1 : 0;
      const RayF& ray = rays[std::min(first + k, rays.size() - 1)];
      p.ray.org_x[k] = ray.origin.x;
      p.ray.org_y[k] = ray.origin.y;
      p.ray.org_z[k] = ray.origin.z;
      p.ray.tnear[k] = ray.t_min;
      p.ray.dir_x[k] = ray.direction.x;
      p.ray.dir_y[k] = ray.direction.y;
      p.ray.dir_z[k] = ray.direction.z;
      p.ray.time[k] = 0;
      p.ray.tfar[k] = ray.t_max;
      p.ray.mask[k] = 0xffffffffu;
      p.ray.id[k] = static_cast<unsigned>(first + k);
      p.ray.flags[k] = 0;
      p.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
      p.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect16(valid, scene_.scene(), context, &p);
  }

  struct RayAndHit {
    EmbreeHit hit;
    unsigned ray;
  };
  EmbreeScene scene_;
  bool packets_;
  bool list_ = false;
  std::vector<std::uint32_t> counts_;
  std::vector<RayAndHit> hits_;
};

void PrintRow(const std::string& mesh, const char* query, const std::string& mode,
              std::vector<double> speeds, std::uint64_t hits) {
  const Spread s = SpreadOf(std::move(speeds));
  std::printf("%s,%s,%s,%.3f,%.3f,%.3f,%llu\n", mesh.c_str(), query, mode.c_str(), s.median, s.low,
              s.high, static_cast<unsigned long long>(hits));
  std::fflush(stdout);
}

/// Points whose crossings on both sides do not add up to an even number.
std::size_t CountWrongParities(const core::Scene& scene, const std::vector<RayF>& rays) {
  std::vector<std::uint32_t> sum(rays.size()), counts(rays.size());
  std::vector<RayF> sent = rays;
  for (int side = 0; side < 2; ++side) {
    if (!core::TraceCount(scene, std::span<const RayF>(sent), {Precision::kExact, {}}, counts).ok())
      std::exit(1);
    for (std::size_t i = 0; i < rays.size(); ++i) sum[i] += counts[i];
    for (RayF& ray : sent) ray.direction = ray.direction * -1.0f;
  }
  return static_cast<std::size_t>(
      std::count_if(sum.begin(), sum.end(), [](std::uint32_t n) { return n % 2 != 0; }));
}

void RunMesh(const std::string& name, const Options& options) {
  const BenchMesh bench = LoadBenchMesh(name);
  const auto mesh =
      std::make_shared<const core::TriangleMesh>(core::TriangleMesh::Create(bench.data).value());
  const core::Scene scene{
      mesh, std::make_shared<const core::Tree>(core::BuildTree(*mesh, options.build).value())};
  const std::vector<RayF> rays = RandomRays(*mesh, options.rays);
  const std::span<const RayF> batch(rays);
  const double millions = static_cast<double>(rays.size()) * 1e-6;
  EmbreeHits single(bench.data, false), packet(bench.data, true);

  for (const bool list : {false, true}) {
    constexpr std::size_t kModes = core::kAllPrecisions.size();
    std::vector<std::vector<double>> ours(kModes), theirs(2);
    std::vector<std::uint64_t> hits(kModes);
    for (int run = 0; run < options.runs; ++run) {
      // The two sides in turn, so a disturbance meets both.
      for (std::size_t m = 0; m < kModes; ++m) {
        core::TraceOptions with;
        with.precision = core::kAllPrecisions[m];
        std::vector<std::uint32_t> counts(rays.size());
        const double start = ThreadSeconds();
        if (list) {
          const auto all = core::TraceAll(scene, batch, with, 1024);
          ours[m].push_back(millions / (ThreadSeconds() - start));
          if (!all.ok()) std::exit(1);
          hits[m] = all->hits.size();
        } else {
          const core::Status status = core::TraceCount(scene, batch, with, counts);
          ours[m].push_back(millions / (ThreadSeconds() - start));
          if (!status.ok()) std::exit(1);
          hits[m] = 0;
          for (const std::uint32_t count : counts) hits[m] += count;
        }
        if (m < 2) theirs[m].push_back(millions / (m == 0 ? single : packet).Run(rays, list));
      }
    }
    const char* query = list ? "all" : "count";
    for (std::size_t m = 0; m < kModes; ++m) {
      PrintRow(name, query, "kdray " + std::string(core::Name(core::kAllPrecisions[m])), ours[m],
               hits[m]);
    }
    PrintRow(name, query, "embree single", theirs[0], single.hits());
    PrintRow(name, query, "embree packet", theirs[1], packet.hits());
  }
  if (core::CheckHealth(*mesh, bench.data).value().closed) {
    const std::vector<RayF> points = RandomRays(*mesh, kParityPoints);
    std::printf("%s,parity,kdray exact,%zu,,,%zu\n", name.c_str(),
                CountWrongParities(scene, points), 2 * points.size());
  }
}

int Main(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    const auto value = [&] {
      if (i + 1 == argc) {
        std::fprintf(stderr, "%s needs a value\n", name.c_str());
        std::exit(2);
      }
      return std::string(argv[++i]);
    };
    if (name == "--mesh") {
      options.meshes.push_back(value());
    } else if (name == "--build") {
      const std::string build = value();
      if (const auto kind = core::ParseBuildKind(build)) {
        options.build = *kind;
      } else {
        std::fprintf(stderr, "no such build: %s\n", build.c_str());
        return 2;
      }
    } else if (name == "--runs") {
      options.runs = std::max(1, std::atoi(value().c_str()));
    } else if (name == "--rays") {
      options.rays = static_cast<std::size_t>(std::max(1, std::atoi(value().c_str())));
    } else if (name == "--quick") {
      options.rays = 100'000;
    } else {
      std::fprintf(stderr, "no such option: %s\n", name.c_str());
      return 2;
    }
  }
  if (options.meshes.empty()) {
    options.meshes = {"bunny_69k", "igea_268k", "classroom_111k", "scan_1m"};
  }
  std::fprintf(stderr, "%s; %zu random rays; SIMD %s\n", MachineLine().c_str(), options.rays,
               std::string(Name(core::BestSimdLevel())).c_str());
  std::printf("mesh,query,mode,mrays_median,mrays_low,mrays_high,hits\n");
  core::Arena arena(1);
  for (const std::string& mesh : options.meshes) {
    arena.Run([&] { RunMesh(mesh, options); });
  }
  return 0;
}

}  // namespace
}  // namespace kdray::bench

int main(int argc, char** argv) { return kdray::bench::Main(argc, argv); }
