// SPDX-License-Identifier: Apache-2.0
// Against Embree in its robust mode, on three real meshes: hit or miss and t agree except for at
// most 1 ray in 10,000 (Embree works in float; each kind of difference is within its rounding).
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/trace/trace.h"
#include "tests/property/scenes.h"
#include "tests/support/mesh_files.h"
#include "tests/support/seed.h"

namespace kdray::test {
namespace {

using namespace core;

class EmbreeScene {
 public:
  explicit EmbreeScene(const MeshData& data)
      : device_(rtcNewDevice("threads=1")), scene_(rtcNewScene(device_)) {
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    const RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), data.vertices.size()));
    for (const Vec3d& v : data.vertices) {
      for (int axis = 0; axis < 3; ++axis) *vertices++ = static_cast<float>(v[axis]);
    }
    auto* indices = static_cast<std::uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(std::uint32_t), data.triangles.size()));
    for (const TriangleIndices& t : data.triangles) {
      for (const std::uint32_t v : t) *indices++ = v;
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_);
  }
  ~EmbreeScene() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  /// t, or infinity.
  double Closest(const RayF& ray) const {
    RTCRayHit query{};
    query.ray = {ray.origin.x,
                 ray.origin.y,
                 ray.origin.z,
                 ray.t_min,
                 ray.direction.x,
                 ray.direction.y,
                 ray.direction.z,
                 0.0f,
                 ray.t_max,
                 0xffffffffu,
                 0,
                 0};
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
#if RTC_VERSION_MAJOR >= 4
    rtcIntersect1(scene_, &query);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene_, &context, &query);
#endif
    return query.hit.geomID == RTC_INVALID_GEOMETRY_ID ? std::numeric_limits<double>::infinity()
                                                       : static_cast<double>(query.ray.tfar);
  }

 private:
  RTCDevice device_;
  RTCScene scene_;
};

std::vector<RayF> Narrowed(const std::vector<Ray>& rays) {
  std::vector<RayF> floats;
  for (const Ray& ray : rays)
    floats.push_back({Vec3f(ray.origin), 0, Vec3f(ray.direction), INFINITY});
  return floats;
}

/// A pinhole camera of width x width pixels that sees the whole mesh.
std::vector<Ray> CameraRays(const Bounds3d& bounds, int width) {
  const Vec3d eye = bounds.Center() + Vec3d{0.4, 0.3, 1} * (1.2 * Length(bounds.Extent()));
  const Vec3d forward = Normalized(bounds.Center() - eye);
  const Vec3d right = Normalized(Cross(forward, Vec3d{0, 1, 0}));
  const Vec3d up = Cross(right, forward);
  std::vector<Ray> rays;
  for (int y = 0; y < width; ++y) {
    for (int x = 0; x < width; ++x) {
      Ray ray;
      ray.origin = eye;
      ray.direction = forward + right * (0.5 * ((2.0 * x + 1) / width - 1)) +
                      up * (0.5 * (1 - (2.0 * y + 1) / width));
      rays.push_back(ray);
    }
  }
  return rays;
}

struct Differences {
  std::size_t hit_or_miss = 0, t = 0, hits = 0;
};

Differences Compare(const EmbreeScene& embree, const Scene& scene, const std::vector<RayF>& rays,
                    Precision precision) {
  std::vector<Hit> hits(rays.size());
  EXPECT_TRUE(TraceClosest(scene, std::span<const RayF>(rays), With(precision), hits).ok());
  Differences differences;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const double t = embree.Closest(rays[i]);
    differences.hits += hits[i].IsHit() ? 1 : 0;
    if (std::isinf(t) == hits[i].IsHit()) {
      ++differences.hit_or_miss;
    } else if (hits[i].IsHit() && std::fabs(t - hits[i].t) > 1e-3 * hits[i].t) {
      ++differences.t;
    }
  }
  return differences;
}

TEST(Embree, AgreesOnRealMeshes) {
  KDRAY_NEED_MESHES();
  auto engine = RandomEngine(20);
  for (const char* file : {"stanford_bunny_69k_ascii.ply", "igea_268k.ply", "classroom_111k.ply"}) {
    const MeshData data = ReadCollectionMesh(file);
    const Scene scene = MakeScene(data, BuildKind::kKdSah);
    const EmbreeScene embree(data);
    const std::vector<RayF> random = Narrowed(RandomRays(scene.mesh->bounds(), 200'000, engine));
    const std::vector<RayF> camera = Narrowed(CameraRays(scene.mesh->bounds(), 512));
    for (const Precision precision :
         {Precision::kFast, Precision::kWatertight, Precision::kDouble}) {
      for (const auto* rays : {&random, &camera}) {
        const Differences d = Compare(embree, scene, *rays, precision);
        std::printf("%s, %s, %zu rays: %zu hits, %zu differ in hit or miss, %zu in t\n", file,
                    std::string(Name(precision)).c_str(), rays->size(), d.hits, d.hit_or_miss, d.t);
        EXPECT_GT(d.hits, rays->size() / 10);
        EXPECT_LE((d.hit_or_miss + d.t) * 10'000, rays->size()) << file << ", " << Name(precision);
      }
    }
  }
}

}  // namespace
}  // namespace kdray::test
