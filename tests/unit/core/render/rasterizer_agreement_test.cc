// SPDX-License-Identifier: Apache-2.0
// The renderer against a second maker of pictures (tests/support/rasterizer.h): the same depth and
// the same triangle in every pixel.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/geometry/local_ray.h"
#include "core/io/mesh_reader.h"
#include "core/render/renderer.h"
#include "tests/support/mesh_files.h"
#include "tests/support/rasterizer.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

using ::kdray::test::DistanceToEdgesPx;
using ::kdray::test::Raster;
using ::kdray::test::RasterCamera;
using ::kdray::test::Rasterize;
using ::kdray::test::Triangle3;

std::vector<Triangle3> TrianglesOf(const MeshData& mesh) {
  std::vector<Triangle3> triangles;
  for (const TriangleIndices& t : mesh.triangles) {
    Triangle3 triangle;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vec3d& v = mesh.vertices[t[i]];
      triangle[i] = {v.x, v.y, v.z};
    }
    triangles.push_back(triangle);
  }
  return triangles;
}

RasterCamera CameraFor(const Camera& camera) {
  const auto point = [](const Vec3d& v) { return test::Point3{v.x, v.y, v.z}; };
  return {.perspective = camera.projection == Projection::kPerspective,
          .eye = point(camera.eye),
          .target = point(camera.target),
          .up = point(camera.up),
          .fov_deg = camera.fov_deg,
          .view_height = camera.view_height,
          .width = camera.width,
          .height = camera.height};
}

// |cos| between a triangle's normal and a ray.
double Cosine(const Triangle3& t, const Vec3d& direction) {
  const Vec3d a = {t[0][0], t[0][1], t[0][2]};
  const Vec3d b = {t[1][0], t[1][1], t[1][2]};
  const Vec3d c = {t[2][0], t[2][1], t[2][2]};
  const Vec3d normal = Cross(b - a, c - a);
  return std::abs(Dot(normal, direction)) / (Length(normal) * Length(direction));
}

// What a precision promises (depths in float besides, and the rasteriser's own rounding).
struct Promise {
  double depth_error;    // times (depth + extent) / |cos|
  double edge_error;     // times the mesh's size: where a ray this near to an edge may fall to
                         // either side of it
  double outline_share;  // of all pixels may do so where the surface ends
};
Promise PromiseOf(Precision precision) {
  if (precision == Precision::kDouble) return {1e-12, 1e-12, 0};
  return {1e-6, kFloatPad, 1e-4};
}

void ExpectAgreement(const MeshData& mesh, const CameraSpec& camera_spec, Precision precision,
                     const std::string& name) {
  SCOPED_TRACE(name + ", " + std::string(Name(precision)));
  const Scene scene = test::MakeScene(mesh);
  RenderSpec spec = {.width = 320, .height = 240, .camera = camera_spec, .precision = precision};
  spec.mode = RenderMode::kDepth;
  const Result<RenderedImage> depth_image = Render(scene, spec);
  spec.mode = RenderMode::kTriangle;
  const Result<RenderedImage> triangle_image = Render(scene, spec);
  ASSERT_TRUE(depth_image.ok() && triangle_image.ok());
  const Camera& camera = depth_image->camera;
  const RasterCamera raster_camera = CameraFor(camera);
  const std::vector<Triangle3> triangles = TrianglesOf(mesh);
  const Raster raster = Rasterize(triangles, raster_camera);

  const Promise promise = PromiseOf(precision);
  const Bounds3d& bounds = scene.mesh->bounds();
  const double extent = MaxAbs(bounds.Extent());
  const double size = 2 * std::max(MaxAbs(bounds.min), MaxAbs(bounds.max));
  std::size_t seen = 0;
  std::size_t on_outline = 0;
  for (int y = 0; y < spec.height; ++y) {
    for (int x = 0; x < spec.width; ++x) {
      const double depth = static_cast<double>(std::get<Film<float>>(depth_image->values)(x, y)[0]);
      const std::int32_t id = std::get<Film<std::int32_t>>(triangle_image->values)(x, y)[0];
      ASSERT_EQ(std::isinf(depth), id == -1);
      const std::size_t at = static_cast<std::size_t>(y * spec.width + x);
      const double other_depth = raster.depth[at];
      const std::int32_t other_id = raster.triangle[at];
      if (id == -1 && other_id == -1) continue;
      ++seen;

      double cosine = 1;
      double edge_px = std::numeric_limits<double>::infinity();
      for (const std::int32_t named : {id, other_id}) {
        if (named == -1) continue;
        const Triangle3& t = triangles[static_cast<std::size_t>(named)];
        cosine = std::min(cosine, Cosine(t, camera.RayThrough(x + 0.5, y + 0.5).direction));
        edge_px = std::min(edge_px, DistanceToEdgesPx(t, raster_camera, x + 0.5, y + 0.5));
      }
      const double tolerance = 0x1p-23 * depth + promise.depth_error * (depth + extent) / cosine;
      if (id != -1 && other_id != -1 && std::abs(depth - other_depth) <= tolerance) continue;

      ++on_outline;
      ASSERT_NE(id, other_id) << "pixel " << x << ',' << y << ": depth " << depth << " and "
                              << other_depth << ", allowed " << tolerance;
      const double nearer = std::min(depth, other_depth);
      ASSERT_LE(edge_px, promise.edge_error * size / camera.PixelSize(nearer))
          << "pixel " << x << ',' << y << ": triangle " << id << " at " << depth << " and "
          << other_id << " at " << other_depth;
    }
  }
  EXPECT_GT(seen, 0u);
  EXPECT_LE(static_cast<double>(on_outline),
            promise.outline_share * static_cast<double>(spec.width * spec.height));
}

struct NamedMesh {
  std::string name;
  MeshData mesh;
};

std::vector<NamedMesh> GeneratedMeshes() {
  std::vector<NamedMesh> meshes = {
      {"cube", test::Cube({0.1, 0.2, 0.3}, 0.7)},
      {"sphere", test::IcoSphere({0, 0, 0}, 1, 5)},
      {"bumpy sphere", test::BumpySphere({5, 6, 7}, 2, 60, 90, 0.4)},
      {"soup", test::Soup(3000, 0.2, 11)},
      {"large soup", test::Straddling(50, 12)},
      {"copies", test::Coincident(20)},
      {"needles", test::Comb(150)},
      {"spiral", test::Spiral(3000, 20)},
      {"nest", test::Nest(12)},
      {"grid", test::Grid(20, 1, 0.5)},
  };
  for (NamedMesh& m : meshes) m.mesh = test::RoundToFloat(m.mesh);
  return meshes;
}

TEST(RasterizerAgreement, HoldsForGeneratedMeshesInBothProjections) {
  for (const NamedMesh& m : GeneratedMeshes()) {
    for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
      for (const Precision precision : {Precision::kWatertight, Precision::kDouble}) {
        ExpectAgreement(m.mesh, {.projection = projection}, precision, m.name);
      }
    }
  }
}

TEST(RasterizerAgreement, HoldsFromInsideTheMesh) {
  for (const NamedMesh& m : GeneratedMeshes()) {
    if (m.name != "soup" && m.name != "sphere" && m.name != "cube") continue;
    const CameraSpec camera = {
        .eye = Vec3d{0.41, 0.52, 0.43}, .target = Vec3d{0.9, 0.7, -0.3}, .fov_deg = 95.0};
    for (const Precision precision : {Precision::kWatertight, Precision::kDouble}) {
      ExpectAgreement(m.mesh, camera, precision, m.name);
    }
  }
}

TEST(RasterizerAgreement, HoldsWhereEdgesRunThroughPixelCentres) {
  // The diagonals of the cube's faces meet pixel centres exactly; its outline does not.
  const MeshData cube = test::Cube({0, 0, 0}, 1);
  for (const Vec3d& eye : {Vec3d{0, 0, 5}, {5, 0, 0}, {-5, 0, 0}, {0, 0, -5}}) {
    const CameraSpec camera = {
        .projection = Projection::kOrthographic, .eye = eye, .target = Vec3d{}, .view_height = 2.4};
    for (const Precision precision : {Precision::kWatertight, Precision::kDouble}) {
      ExpectAgreement(cube, camera, precision, "cube");
    }
  }
}

// Scans, models with holes, slivers, folds, coordinates far from 0, polygons.
TEST(RasterizerAgreement, HoldsForRealMeshes) {
  KDRAY_NEED_MESHES();
  for (const char* file :
       {"stanford_bunny_69k_ascii.ply", "teapot.obj", "utah_teapot.stl", "fandisk.obj",
        "camelhead.off", "slivers_112932.stl", "needles_1514499.stl", "twin_large_coords.obj",
        "office_chair.obj", "cornell_box_negidx.obj", "suzanne_quads_st.ply", "bunny_292.stl"}) {
    const Result<MeshData> mesh = ReadMesh(test::ReadFileBytes(*test::MeshFolder() / file));
    ASSERT_TRUE(mesh.ok()) << file << ": " << mesh.error().message;
    const Precision precision = AutoPrecision(*TriangleMesh::Create(*mesh));
    for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
      ExpectAgreement(*mesh, {.projection = projection}, precision, file);
      ExpectAgreement(*mesh, {.projection = projection, .up = Vec3d{0.3, -0.2, 1}},
                      Precision::kDouble, file);
    }
  }
}

}  // namespace
}  // namespace kdray::core
