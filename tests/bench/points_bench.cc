// SPDX-License-Identifier: Apache-2.0
// The closest point of a mesh beside CGAL's AABB tree (with the kernel EPICK and its search tree
// for hints), taken in turn in one process on one thread, on the same points; and exact closest
// points, signed distances and inside queries of the same points.
//
// Options: --mesh NAME (may be repeated; default: bunny_69k and igea_268k), --points N (default
// 200000), --runs N (default 5), --csv FILE.
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/geometry/mesh_health.h"
#include "core/proximity/closest_points.h"
#include "core/proximity/sides.h"
#include "core/scene/scene.h"
#include "tests/bench/scenes.h"

namespace kdray::bench {
namespace {

using core::ClosestPoint;
using core::PointPrecision;
using core::Scene;
using core::Vec3d;

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using CgalTree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

struct Options {
  std::vector<std::string> meshes;
  std::size_t points = 200'000;
  int runs = 5;
  std::string csv;
};

/// Processor time of this thread, which other programs do not change.
double ThreadSeconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}
double SecondsOf(const auto& work) {
  const double start = ThreadSeconds();
  work();
  return ThreadSeconds() - start;
}

struct PointSet {
  std::string name;
  std::vector<Vec3d> points;
};

/// Points in twice the bounds, and points up to a thousandth of the mesh's size off its surface;
/// both in random order.
std::vector<PointSet> MakePoints(const core::MeshData& data, const core::Bounds3d& bounds,
                                 std::size_t count) {
  std::mt19937_64 engine(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  PointSet around{"in twice the box", {}}, near{"near the surface", {}};
  const Vec3d center = bounds.Center(), extent = bounds.Extent();
  const double size = MaxAbs(extent);
  for (std::size_t i = 0; i < count; ++i) {
    Vec3d anywhere, off;
    for (int axis = 0; axis < 3; ++axis) {
      anywhere[axis] = center[axis] + 2 * extent[axis] * (uniform(engine) - 0.5);
      off[axis] = 2e-3 * size * (uniform(engine) - 0.5);
    }
    around.points.push_back(anywhere);
    const core::TriangleIndices& t = data.triangles[engine() % data.triangles.size()];
    double u = uniform(engine), v = uniform(engine);
    if (u + v > 1) {
      u = 1 - u;
      v = 1 - v;
    }
    near.points.push_back(data.vertices[t[0]] * (1 - u - v) + data.vertices[t[1]] * u +
                          data.vertices[t[2]] * v + off);
  }
  return {around, near};
}

Kernel::Point_3 ToCgal(const Vec3d& v) { return {v.x, v.y, v.z}; }

/// One way to answer, and its times.
struct Way {
  std::string name;
  std::vector<double> seconds;
};

template <class T>
T Value(core::Result<T> result) {
  if (!result.ok()) {
    std::fprintf(stderr, "bench_points: %s\n", result.error().message.c_str());
    std::exit(1);
  }
  return *std::move(result);
}

void Measure(const Options& options, const BenchMesh& bench, std::ofstream* csv) {
  core::Arena arena(1);
  const auto mesh =
      std::make_shared<const core::TriangleMesh>(Value(core::TriangleMesh::Create(bench.data)));
  Scene scene{mesh, nullptr};
  arena.Run([&] {
    scene.tree =
        std::make_shared<const core::Tree>(Value(core::BuildTree(*mesh, core::BuildKind::kKdSah)));
  });
  scene.is_closed = Value(core::CheckHealth(*mesh, bench.data)).closed;

  Triangles triangles;
  for (const core::TriangleIndices& t : bench.data.triangles) {
    triangles.emplace_back(ToCgal(bench.data.vertices[t[0]]), ToCgal(bench.data.vertices[t[1]]),
                           ToCgal(bench.data.vertices[t[2]]));
  }
  CgalTree cgal(triangles.cbegin(), triangles.cend());
  const double cgal_build = SecondsOf([&] {
    cgal.build();
    cgal.accelerate_distance_queries();
  });
  std::printf(
      "\n#### %s: %zu triangles, one thread; CGAL's tree takes %.2f s\n\n"
      "| points | CGAL us | double us | ratio | exact us | signed distance us | inside us | "
      "largest difference |\n|---|---|---|---|---|---|---|---|\n",
      bench.name.c_str(), mesh->triangle_count(), cgal_build);

  for (const PointSet& set : MakePoints(bench.data, mesh->bounds(), options.points)) {
    const std::size_t count = set.points.size();
    std::vector<Kernel::Point_3> queries;
    for (const Vec3d& p : set.points) queries.push_back(ToCgal(p));
    std::vector<Kernel::Point_3> theirs(count);
    std::vector<ClosestPoint> ours(count), exact(count);
    std::vector<double> signed_distances(count);
    std::vector<core::Side> sides(count);
    std::vector<Way> ways = {
        {"cgal", {}}, {"double", {}}, {"exact", {}}, {"signed", {}}, {"inside", {}}};
    const auto find = [&](PointPrecision precision, std::vector<ClosestPoint>* answers) {
      (void)FindClosestPoints(scene, set.points, {.precision = precision, .cancel = {}}, *answers);
    };
    for (int run = 0; run < options.runs; ++run) {
      ways[0].seconds.push_back(SecondsOf([&] {
        for (std::size_t i = 0; i < count; ++i) theirs[i] = cgal.closest_point(queries[i]);
      }));
      arena.Run([&] {
        ways[1].seconds.push_back(SecondsOf([&] { find(PointPrecision::kDouble, &ours); }));
        ways[2].seconds.push_back(SecondsOf([&] { find(PointPrecision::kExact, &exact); }));
        ways[3].seconds.push_back(
            SecondsOf([&] { (void)FindSignedDistances(scene, set.points, {}, signed_distances); }));
        ways[4].seconds.push_back(
            SecondsOf([&] { (void)FindSides(scene, set.points, {}, sides); }));
      });
    }
    double difference = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3d p{theirs[i].x(), theirs[i].y(), theirs[i].z()};
      difference = std::max(difference, std::fabs(Length(p - set.points[i]) - ours[i].distance));
    }
    std::vector<double> us;
    for (const Way& way : ways) {
      const Spread spread = SpreadOf(way.seconds);
      us.push_back(spread.median / static_cast<double>(count) * 1e6);
      if (csv->is_open()) {
        *csv << bench.name << ',' << set.name << ',' << way.name << ',' << count << ','
             << spread.median << ',' << spread.low << ',' << spread.high << '\n';
      }
    }
    std::printf("| %s | %.2f | %.3f | **%.1f** | %.3f | %.3f | %.3f | %.1e |\n", set.name.c_str(),
                us[0], us[1], us[0] / us[1], us[2], us[3], us[4],
                difference / MaxAbs(mesh->bounds().Extent()));
    std::fflush(stdout);
  }
}

Options Parse(int count, char** arguments) {
  Options options;
  for (int i = 1; i < count; ++i) {
    const auto value = [&] {
      if (i + 1 == count) {
        std::fprintf(stderr, "bench_points: %s needs a value\n", arguments[i]);
        std::exit(2);
      }
      return arguments[++i];
    };
    if (std::strcmp(arguments[i], "--mesh") == 0) {
      options.meshes.emplace_back(value());
    } else if (std::strcmp(arguments[i], "--points") == 0) {
      options.points = static_cast<std::size_t>(std::atoll(value()));
    } else if (std::strcmp(arguments[i], "--runs") == 0) {
      options.runs = std::atoi(value());
    } else if (std::strcmp(arguments[i], "--csv") == 0) {
      options.csv = value();
    } else {
      std::fprintf(stderr, "bench_points: there is no option %s\n", arguments[i]);
      std::exit(2);
    }
  }
  if (options.meshes.empty()) options.meshes = {"bunny_69k", "igea_268k"};
  return options;
}

void Run(const Options& options) {
  std::ofstream csv;
  if (!options.csv.empty()) {
    csv.open(options.csv);
    csv << "mesh,points,way,count,median_s,low_s,high_s\n";
  }
  std::printf("%s; %d runs, medians; %zu points a set; SIMD %s\n", MachineLine().c_str(),
              options.runs, options.points, std::string(Name(core::BestSimdLevel())).c_str());
  for (const std::string& name : options.meshes) Measure(options, LoadBenchMesh(name), &csv);
}

}  // namespace
}  // namespace kdray::bench

int main(int count, char** arguments) {
  kdray::bench::Run(kdray::bench::Parse(count, arguments));
  return 0;
}
