// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/scenes.h"

#include <xmmintrin.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <thread>

#include "core/base/parallel.h"
#include "core/io/mesh_reader.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "tests/bench/interior.h"
#include "tests/support/mesh_files.h"

namespace kdray::bench {

using core::Bounds3d;
using core::MeshData;
using core::Ray;
using core::RayF;
using core::Vec3d;
using core::Vec3f;

namespace {

[[noreturn]] void Fail(const std::string& message) {
  std::fprintf(stderr, "%s\n", message.c_str());
  std::exit(2);
}

Vec3d Displaced(const Vec3d& on_sphere) {
  double height = 0;
  double length = 1;
  Vec3d p = on_sphere;
  for (int octave = 0; octave < 7; ++octave) {
    height += 0.11 * length * std::sin(3.1 * p.x / length + octave) *
              std::sin(2.7 * p.y / length + 2 * octave) * std::sin(3.7 * p.z / length + 3 * octave);
    length *= 0.55;
    p = {p.y, p.z, p.x};
  }
  return on_sphere * (0.5 * (1 + height));
}

}  // namespace

MeshData FoldedSphere(int frequency) {
  // A geodesic sphere: each face of an icosahedron as a grid of frequency^2 triangles. Vertices on
  // shared edges are computed once for each face, from the same corners in the same order, so that
  // they agree to the bit.
  const double g = (1 + std::sqrt(5.0)) / 2;
  const Vec3d corners[12] = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                             {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                             {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
  const int faces[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                            {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                            {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                            {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  MeshData data;
  data.format = core::MeshFormat::kPly;
  data.single_precision = true;
  // A vertex by the weights of the icosahedron's corners, so that neighbours share it.
  std::map<std::array<int, 6>, std::uint32_t> shared;
  const auto vertex = [&](const int* face, int b, int c) {
    std::array<std::pair<int, int>, 3> weights = {
        {{face[0], frequency - b - c}, {face[1], b}, {face[2], c}}};
    std::sort(weights.begin(), weights.end());
    std::array<int, 6> key{};
    std::size_t used = 0;
    Vec3d sum{0, 0, 0};
    for (const auto& [corner, weight] : weights) {
      if (weight == 0) continue;
      key[used++] = corner + 1;
      key[used++] = weight;
      sum = sum + corners[corner] * (static_cast<double>(weight) / frequency);
    }
    const bool on_border = used < 6;
    const auto make = [&] {
      data.vertices.push_back(Vec3d(Vec3f(Displaced(core::Normalized(sum)))));
      return static_cast<std::uint32_t>(data.vertices.size() - 1);
    };
    if (!on_border) return make();
    const auto [found, is_new] = shared.try_emplace(key, 0);
    if (is_new) found->second = make();
    return found->second;
  };
  for (const auto& face : faces) {
    std::vector<std::uint32_t> row, above;
    for (int b = 0; b <= frequency; ++b) {
      row.clear();
      for (int c = 0; c <= frequency - b; ++c) row.push_back(vertex(face, b, c));
      for (std::size_t c = 0; b > 0 && c < row.size(); ++c) {
        data.triangles.push_back({above[c], row[c], above[c + 1]});
        if (c + 1 < row.size()) data.triangles.push_back({row[c], row[c + 1], above[c + 1]});
      }
      above = row;
    }
  }
  return data;
}

BenchMesh LoadBenchMesh(const std::string& name) {
  if (name == "scan_1m") return {name, FoldedSphere(235), {}};
  if (name == "scan_4m") return {name, FoldedSphere(470), {}};
  if (name == "office") {
    return {name, OfficeFloor(),
            BenchView{{9, 1.7, 8.5}, {13, 1.1, 3}, {0, 1, 0}, {12.5, 2.5, 5.5}, 0.7}};
  }
  const std::map<std::string, std::string> files = {{"bunny_69k", "stanford_bunny_69k_ascii.ply"},
                                                    {"igea_268k", "igea_268k.ply"},
                                                    {"classroom_111k", "classroom_111k.ply"},
                                                    {"classroom_inside", "classroom_111k.ply"},
                                                    {"classroom_outside", "classroom_111k.ply"}};
  const auto file = files.find(name);
  if (file == files.end()) Fail("no benchmark mesh is called " + name);
  const auto folder = test::MeshFolder();
  if (!folder) Fail("the mesh collection is not there: set KDRAY_MESHES");
  auto data = core::ReadMesh(test::ReadFileBytes(*folder / file->second));
  if (!data.ok()) Fail(data.error().message);
  // Decimal fractions are no floats; Embree would round them, so both get the rounded ones.
  for (Vec3d& v : data->vertices) v = Vec3d(Vec3f(v));
  data->single_precision = true;
  std::optional<BenchView> view;
  if (name == "classroom_inside") {
    view = {{-5.8, 1.8, 0.45}, {-2, -1.2, -0.35}, {0, 0, 1}, {-3.2, 0.3, 0.8}, 0.7};
  }
  return {name, *std::move(data), view};
}

BenchView ViewOf(const core::TriangleMesh& mesh, const BenchMesh& bench) {
  if (bench.view) return *bench.view;
  const Bounds3d bounds = mesh.bounds();
  const double size = core::Length(bounds.Extent());
  return {bounds.Center() + core::Normalized(Vec3d{0.3, 0.35, 1}) * (1.1 * size),
          bounds.Center(),
          {0, 1, 0},
          bounds.Center() + Vec3d{0.6, 0.9, 0.7} * size};
}

std::vector<BenchRays> MakeRayClasses(const core::TriangleMesh& mesh, const BenchMesh& bench,
                                      int side) {
  const MeshData& data = bench.data;
  std::mt19937_64 engine(20061);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<>(low, high)(engine);
  };
  const Bounds3d bounds = mesh.bounds();
  const double size = core::Length(bounds.Extent());
  const float kInf = std::numeric_limits<float>::infinity();

  const BenchView view = ViewOf(mesh, bench);
  const Vec3d eye = view.eye;
  const Vec3d forward = core::Normalized(view.target - eye);
  const Vec3d right = core::Normalized(core::Cross(forward, view.up));
  const Vec3d up = core::Cross(right, forward);
  const auto camera = [&](int pixels) {
    BenchRays primary{"primary, pixel order", false, {}};
    for (int ty = 0; ty < pixels; ty += 8) {
      for (int tx = 0; tx < pixels; tx += 8) {
        for (int y = ty; y < ty + 8; ++y) {
          for (int x = tx; x < tx + 8; ++x) {
            const Vec3d direction = forward +
                                    right * (view.half_width * ((2.0 * x + 1) / pixels - 1)) +
                                    up * (view.half_width * (1 - (2.0 * y + 1) / pixels));
            primary.rays.push_back({Vec3f(eye), 0, Vec3f(direction), kInf});
          }
        }
      }
    }
    return primary;
  };
  const BenchRays primary = camera(side);

  // Secondary rays start from the hits, moved off the surface by 1e-4 of the size.
  const auto shared = std::make_shared<const core::TriangleMesh>(mesh);
  const auto tree =
      std::make_shared<const core::Tree>(core::BuildTree(mesh, core::BuildKind::kKdBinned).value());
  std::vector<core::Hit> hits(primary.rays.size());
  const core::Status status =
      core::TraceClosest({shared, tree}, std::span<const RayF>(primary.rays),
                         {core::Precision::kWatertight, {}}, hits);
  if (!status.ok()) Fail(status.error().message);
  BenchRays diffuse{"diffuse, pixel order", false, {}};
  BenchRays shadow{"shadow, pixel order", true, {}};
  for (std::size_t i = 0; i < hits.size(); ++i) {
    if (!hits[i].IsHit()) continue;
    const auto& t = data.triangles[hits[i].primitive_id];
    Vec3d normal = core::Cross(data.vertices[t[1]] - data.vertices[t[0]],
                               data.vertices[t[2]] - data.vertices[t[0]]);
    normal = core::Normalized(normal);
    if (core::Dot(normal, Vec3d(primary.rays[i].direction)) > 0) normal = -normal;
    const Vec3d at = Vec3d(primary.rays[i].origin) + Vec3d(primary.rays[i].direction) * hits[i].t +
                     normal * (1e-4 * size);
    // Cosine-distributed: a point of the unit sphere around the normal's tip.
    Vec3d p;
    do {
      p = {uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)};
    } while (core::Dot(p, p) > 1 || core::Dot(p, p) < 1e-6);
    diffuse.rays.push_back({Vec3f(at), 0, Vec3f(normal + core::Normalized(p) * 0.999), kInf});
    shadow.rays.push_back({Vec3f(at), 0, Vec3f(view.lamp - at), 1});
  }
  const auto shuffled = [&](const BenchRays& from, const char* name) {
    BenchRays to{name, from.any, from.rays};
    std::shuffle(to.rays.begin(), to.rays.end(), engine);
    return to;
  };
  BenchRays random{"random", false, {}};
  const auto point = [&] {
    return Vec3d{uniform(bounds.min.x, bounds.max.x), uniform(bounds.min.y, bounds.max.y),
                 uniform(bounds.min.z, bounds.max.z)};
  };
  for (std::size_t i = 0; i < primary.rays.size(); ++i) {
    const Vec3f from(point());
    random.rays.push_back({from, 0, Vec3f(point()) - from, kInf});
  }
  std::vector<BenchRays> classes;
  BenchRays diffuse_shuffled = shuffled(diffuse, "diffuse, shuffled");
  BenchRays shadow_shuffled = shuffled(shadow, "shadow, shuffled");
  classes.push_back(camera(2 * side));
  classes.push_back(std::move(diffuse_shuffled));
  classes.push_back(std::move(diffuse));
  classes.push_back(std::move(shadow));
  classes.push_back(std::move(shadow_shuffled));
  classes.push_back(std::move(random));
  return classes;
}

FlushDenormals::FlushDenormals() : before_(_mm_getcsr()) { _mm_setcsr(before_ | 0x8040); }
FlushDenormals::~FlushDenormals() { _mm_setcsr(before_); }

EmbreeScene::EmbreeScene(const MeshData& data, RTCBuildQuality quality, bool robust, int threads) {
  const FlushDenormals flush;
  device_ = rtcNewDevice(("threads=" + std::to_string(threads)).c_str());
  std::atomic<long long> held{0};
  rtcSetDeviceMemoryMonitorFunction(
      device_,
      [](void* total, ssize_t bytes, bool) {
        *static_cast<std::atomic<long long>*>(total) += bytes;
        return true;
      },
      &held);
  scene_ = rtcNewScene(device_);
  rtcSetSceneBuildQuality(scene_, quality);
  if (robust) rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
  const RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetGeometryBuildQuality(geometry, quality);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, data.vertices.size()));
  for (std::size_t i = 0; i < data.vertices.size(); ++i) {
    const Vec3f v(data.vertices[i]);
    std::memcpy(vertices + 3 * i, &v, 12);
  }
  auto* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12,
                                          data.triangles.size());
  std::memcpy(indices, data.triangles.data(), 12 * data.triangles.size());
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene_, geometry);
  rtcReleaseGeometry(geometry);
  const long long before = held;
  const auto start = std::chrono::steady_clock::now();
  rtcCommitScene(scene_);
  build_seconds_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  bytes_ = static_cast<std::size_t>(std::max(0LL, held - before));
  rtcSetDeviceMemoryMonitorFunction(device_, nullptr, nullptr);
}

EmbreeScene::~EmbreeScene() {
  const FlushDenormals flush;
  rtcReleaseScene(scene_);
  rtcReleaseDevice(device_);
}

bool IsMismatch(double ours, double theirs) {
  if (std::isinf(ours) || std::isinf(theirs)) return std::isinf(ours) != std::isinf(theirs);
  return std::fabs(ours - theirs) > 1e-3 * std::fabs(theirs);
}

Spread SpreadOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {values[values.size() / 2], values.front(), values.back()};
}

std::string MachineLine() {
  std::ifstream info("/proc/cpuinfo");
  std::string line, model = "unknown processor";
  while (std::getline(info, line)) {
    if (line.starts_with("model name")) {
      model = line.substr(line.find(':') + 2);
      break;
    }
  }
  std::ifstream load("/proc/loadavg");
  std::string one = "?";
  load >> one;
  return model + ", " + std::to_string(std::thread::hardware_concurrency()) +
         " threads, load before the run " + one;
}

}  // namespace kdray::bench
