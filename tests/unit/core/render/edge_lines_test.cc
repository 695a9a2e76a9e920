// SPDX-License-Identifier: Apache-2.0
// Lines of edges against where the edges of simple meshes must appear.
#include "core/render/edge_lines.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "core/render/framing.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray::core {
namespace {

constexpr int kWidth = 200, kHeight = 160;

Camera CameraFor(const Scene& scene, const CameraSpec& spec) {
  Result<Camera> camera = ResolveCamera(spec, scene.mesh->bounds(), kWidth, kHeight);
  if (!camera.ok()) throw std::runtime_error(camera.error().message);
  return *camera;
}

// The sides of a cube's triangles that are edges of the cube: along one axis.
SidesOfTriangle SidesOfCube(const Scene& scene) {
  return [&mesh = *scene.mesh](PrimitiveId id) {
    unsigned sides = 0;
    for (int k = 0; k < 3; ++k) {
      const Vec3d along = mesh.LocalCorner(id, (k + 1) % 3) - mesh.LocalCorner(id, k);
      const int axes = (along.x != 0) + (along.y != 0) + (along.z != 0);
      if (axes == 1) sides |= 1u << k;
    }
    return static_cast<std::uint8_t>(sides);
  };
}

// The opacities of a whole image.
class Lines {
 public:
  Lines(const Scene& scene, const Camera& camera, SidesOfTriangle sides) : camera_(camera) {
    const EdgeLines lines(scene, camera, std::move(sides));
    Result<std::vector<float>> drawn = lines.Draw({0, 0, kWidth, kHeight}, {});
    if (!drawn.ok()) throw std::runtime_error(drawn.error().message);
    opacity_ = *std::move(drawn);
  }
  float At(int x, int y) const { return opacity_[static_cast<std::size_t>(y * kWidth + x)]; }
  // At the pixel in which a point appears.
  float At(const Vec3d& point) const {
    if (camera_.projection != Projection::kSpherical) {
      const Camera::ImagePoint at = camera_.ToImage(camera_.ToView(point));
      return At(static_cast<int>(at.x_px), static_cast<int>(at.y_px));
    }
    const Vec3d d = Normalized(point - camera_.eye);
    const double azimuth = std::atan2(Dot(d, camera_.right), Dot(d, camera_.forward));
    const double elevation = std::asin(Dot(d, camera_.upward));
    // The last column ends where the first begins, and the last row ends straight down.
    const int y = static_cast<int>((0.5 - elevation / camera_.v_fov) * kHeight);
    return At(static_cast<int>((azimuth / camera_.h_fov + 0.5) * kWidth) % kWidth,
              std::min(y, kHeight - 1));
  }

  // From a point to the nearest of some, in the image, pixels; not spherical.
  double Distance(const Vec3d& point, const std::vector<Vec3d>& points) const {
    const Camera::ImagePoint at = camera_.ToImage(camera_.ToView(point));
    double least = HUGE_VAL;
    for (const Vec3d& other : points) {
      const Camera::ImagePoint p = camera_.ToImage(camera_.ToView(other));
      least = std::min(least, std::hypot(p.x_px - at.x_px, p.y_px - at.y_px));
    }
    return least;
  }

 private:
  const Camera camera_;
  std::vector<float> opacity_;
};

struct Edge {
  Vec3d from, to;
  std::vector<Vec3d> normals;  // of its two faces
};

// The twelve edges of the cube from -1 to 1.
std::vector<Edge> EdgesOfCube() {
  std::vector<Edge> edges;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double b : {-1.0, 1.0}) {
      for (const double c : {-1.0, 1.0}) {
        Vec3d middle, along, normal_b, normal_c;
        along[axis] = 1;
        normal_b[(axis + 1) % 3] = b;
        normal_c[(axis + 2) % 3] = c;
        middle = normal_b + normal_c;
        edges.push_back({middle - along, middle + along, {normal_b, normal_c}});
      }
    }
  }
  return edges;
}

// The middles of the cube's faces, and other points of its faces' diagonals.
std::vector<Vec3d> DiagonalsOfCube() {
  std::vector<Vec3d> points;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      for (const double s : {-0.6, -0.3, 0.0, 0.3, 0.6}) {
        for (const double sign : {-1.0, 1.0}) {
          Vec3d p;
          p[axis] = side;
          p[(axis + 1) % 3] = s;
          p[(axis + 2) % 3] = s * sign;
          points.push_back(p);
        }
      }
    }
  }
  return points;
}

constexpr float kClear = kEdgeOpacity * 0.38f;  // a line through the pixel, off its centre

TEST(EdgeLines, OfACubeAreItsTwelveEdgesAndNoDiagonal) {
  // From within, all of them are seen.
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  const Camera camera = CameraFor(scene, {.projection = Projection::kSpherical});
  const Lines lines(scene, camera, SidesOfCube(scene));
  for (const Edge& edge : EdgesOfCube()) {
    for (const double s : {0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9}) {
      EXPECT_GT(lines.At(edge.from + (edge.to - edge.from) * s), kClear);
    }
  }
  for (const Vec3d& point : DiagonalsOfCube()) EXPECT_EQ(lines.At(point), 0);

  const Lines all(scene, camera, [](PrimitiveId) { return kAllSides; });
  int diagonals = 0;
  for (const Vec3d& point : DiagonalsOfCube()) diagonals += all.At(point) > kClear ? 1 : 0;
  EXPECT_GE(diagonals, 30) << "one of the two diagonals of each face";
}

TEST(EdgeLines, OfACubeFromOutsideAreThoseOfTheFacesThatAreSeen) {
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  for (const Projection projection : {Projection::kPerspective, Projection::kOrthographic}) {
    for (const Vec3d& up : {Vec3d{0, 1, 0}, {1, 2, -2}, {0, -1, 0.4}}) {
      const Camera camera = CameraFor(scene, {.projection = projection, .up = up});
      const Lines lines(scene, camera, SidesOfCube(scene));
      const auto is_seen = [&](const Vec3d& normal) {
        const Vec3d toward =
            projection == Projection::kPerspective ? camera.eye - normal : -camera.forward;
        return Dot(normal, toward) > 0;
      };
      std::vector<Vec3d> visible;
      for (const Edge& edge : EdgesOfCube()) {
        if (!is_seen(edge.normals[0]) && !is_seen(edge.normals[1])) continue;
        for (int i = 0; i <= 100; ++i) {
          visible.push_back(edge.from + (edge.to - edge.from) * (i / 100.0));
        }
      }
      int seen = 0, hidden = 0;
      for (const Edge& edge : EdgesOfCube()) {
        const bool expected = is_seen(edge.normals[0]) || is_seen(edge.normals[1]);
        seen += expected ? 1 : 0;
        for (const double s : {0.25, 0.5, 0.7}) {
          const float opacity = lines.At(edge.from + (edge.to - edge.from) * s);
          if (expected) {
            EXPECT_GT(opacity, kClear);
          } else if (lines.Distance(edge.from + (edge.to - edge.from) * s, visible) > 3) {
            EXPECT_EQ(opacity, 0) << "hidden";
            ++hidden;
          }
        }
      }
      EXPECT_EQ(seen, 9);
      EXPECT_GT(hidden, 3);
      for (const Vec3d& point : DiagonalsOfCube()) {
        Vec3d normal;
        for (int axis = 0; axis < 3; ++axis) normal[axis] = std::trunc(point[axis]);
        if (!is_seen(normal)) continue;
        EXPECT_EQ(lines.At(point), 0);
      }
    }
  }
}

TEST(EdgeLines, AreAsWideAtSilhouettesAsBetweenFaces) {
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  for (const double shift : {0.0, 0.3, 0.5, 0.8}) {
    // The cube's left edge and right edge cross the middle row.
    const Camera camera = CameraFor(scene, {.projection = Projection::kOrthographic,
                                            .eye = Vec3d{shift / 40, 0, 5},
                                            .target = Vec3d{shift / 40, 0, 0},
                                            .view_height = 4.0});
    const Lines lines(scene, camera, SidesOfCube(scene));
    for (const int begin : {0, kWidth / 2}) {
      double sum = 0;
      for (int x = begin; x < begin + kWidth / 2; ++x)
        sum += static_cast<double>(lines.At(x, kHeight / 2));
      EXPECT_NEAR(sum, kEdgeWidthPx * static_cast<double>(kEdgeOpacity), 0.15) << shift;
    }
  }
}

TEST(EdgeLines, AreHiddenByASurfaceInFront) {
  MeshData mesh;  // a small square before a large one, whose diagonal it hides in the middle
  const auto add_square = [&](double half, double z) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(),
                         {{-half, -half, z}, {half, -half, z}, {half, half, z}, {-half, half, z}});
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.triangles.push_back({first, first + 2, first + 3});
  };
  add_square(2, 0);
  add_square(1, 0.5);
  const Scene scene = test::MakeScene(mesh);
  const Camera camera =
      CameraFor(scene, {.projection = Projection::kOrthographic, .view = View::kFront});
  // Only the large square's edges are drawn.
  const Lines lines(scene, camera, [](PrimitiveId id) { return id < 2 ? kAllSides : 0; });
  EXPECT_GT(lines.At({1.5, 1.5, 0}), kClear);
  EXPECT_GT(lines.At({-1.5, -1.5, 0}), kClear);
  EXPECT_EQ(lines.At({0, 0, 0}), 0);
  EXPECT_EQ(lines.At({0.9, 0.9, 0}), 0);
}

TEST(EdgeLines, OfTilesJoinBitForBit) {
  const Scene scene = test::MakeScene(test::BumpySphere({0, 0, 0}, 1, 30, 40, 0.3));
  for (const Projection projection :
       {Projection::kPerspective, Projection::kOrthographic, Projection::kSpherical}) {
    CameraSpec spec = {.projection = projection};
    if (projection == Projection::kSpherical) spec.eye = Vec3d{0, 0, 2};
    const Camera camera = CameraFor(scene, spec);
    const EdgeLines lines(scene, camera, [](PrimitiveId) { return kAllSides; });
    const Lines whole(scene, camera, [](PrimitiveId) { return kAllSides; });
    for (const Tile& tile : {Tile{0, 0, 100, 160}, {100, 0, 200, 77}, {100, 77, 200, 160}}) {
      const Result<std::vector<float>> part = lines.Draw(tile, {});
      ASSERT_TRUE(part.ok());
      std::size_t i = 0;
      for (int y = tile.y0; y < tile.y1; ++y) {
        for (int x = tile.x0; x < tile.x1; ++x, ++i) ASSERT_EQ((*part)[i], whole.At(x, y));
      }
    }
  }
}

TEST(EdgeLines, StopWhenCancelled) {
  const Scene scene = test::MakeScene(test::Cube({0, 0, 0}, 1));
  const Camera camera = CameraFor(scene, {});
  const CancelToken cancel = CancelToken::Cancellable();
  cancel.Cancel();
  const EdgeLines lines(scene, camera, [](PrimitiveId) { return kAllSides; });
  EXPECT_EQ(lines.Draw({0, 0, kWidth, kHeight}, {.cancel = cancel}).error().code,
            ErrorCode::kCancelled);
}

}  // namespace
}  // namespace kdray::core
