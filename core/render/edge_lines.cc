// SPDX-License-Identifier: Apache-2.0
#include "core/render/edge_lines.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <utility>

#include "core/base/cancel_poll.h"
#include "core/render/centre_values.h"
#include "core/render/shading.h"

namespace kdray::core {
namespace {

// From the middle of a line to where it is invisible.
constexpr double kReachPx = kEdgeWidthPx / 2 + 0.5;
// An edge is hidden if it lies farther than this behind the plane of the pixel's own triangle: a
// curved surface bends by less within a pixel.
constexpr double kHiddenBySizePx = 1;
// Work (CancelPoll) of a pixel, and of drawing a triangle's edges into it.
constexpr std::uint64_t kPixelWork = 64;
constexpr std::uint64_t kTriangleWork = 256;

// The triangles that the rays of a pixel and its neighbours hit, each once.
class NearTriangles {
 public:
  void Add(PrimitiveId id) {
    if (id == kNoPrimitive || std::find(begin(), end(), id) != end()) return;
    ids_[count_++] = id;
  }
  const PrimitiveId* begin() const { return ids_.data(); }
  const PrimitiveId* end() const { return ids_.data() + count_; }

 private:
  std::array<PrimitiveId, 9> ids_;
  std::size_t count_ = 0;
};

Vec3d WorldCorner(const TriangleMesh& mesh, PrimitiveId id, int corner) {
  return mesh.frame().ToWorld(mesh.LocalCorner(id, corner));
}

// The point of a line that appears nearest to a point of the image.
struct NearestPoint {
  double distance_px = 0;
  Vec3d world;
  double depth = 0;
};

// nullopt if the line is behind the eye.
std::optional<NearestPoint> Nearest(const Camera& flat, double x_px, double y_px, const Vec3d& from,
                                    const Vec3d& to) {
  Camera::ViewPoint a = flat.ToView(from);
  Camera::ViewPoint b = flat.ToView(to);
  Vec3d world_a = from;
  Vec3d world_b = to;
  const bool perspective = flat.projection == Projection::kPerspective;
  // Cuts off what is behind the eye, and so near to it that its place in the image means nothing.
  const double nearest = std::max(a.depth, b.depth) * 1e-6;
  if (!(nearest > 0)) return std::nullopt;
  const auto cut = [&](Camera::ViewPoint* behind, Vec3d* world_behind,
                       const Camera::ViewPoint& before, const Vec3d& world_before) {
    if (behind->depth >= nearest) return;
    const double s = (nearest - behind->depth) / (before.depth - behind->depth);
    behind->x += s * (before.x - behind->x);
    behind->y += s * (before.y - behind->y);
    behind->depth = nearest;
    *world_behind = *world_behind + (world_before - *world_behind) * s;
  };
  cut(&a, &world_a, b, world_b);
  cut(&b, &world_b, a, world_a);
  const Camera::ImagePoint p = flat.ToImage(a);
  const Camera::ImagePoint q = flat.ToImage(b);
  const double dx = q.x_px - p.x_px;
  const double dy = q.y_px - p.y_px;
  const double length2 = dx * dx + dy * dy;
  const double along =
      length2 > 0 ? std::clamp(((x_px - p.x_px) * dx + (y_px - p.y_px) * dy) / length2, 0.0, 1.0)
                  : 0.0;
  const double distance = std::hypot(x_px - (p.x_px + along * dx), y_px - (p.y_px + along * dy));
  if (!std::isfinite(distance)) return std::nullopt;
  // Equal steps in the image are steps in 1 / depth along the line.
  const double weight_a = (1 - along) * (perspective ? b.depth : 1.0);
  const double weight_b = along * (perspective ? a.depth : 1.0);
  const double share = weight_b / (weight_a + weight_b);
  return NearestPoint{distance, world_a + (world_b - world_a) * share,
                      a.depth + (b.depth - a.depth) * share};
}

}  // namespace

// The triangle that a pixel's centre shows.
struct EdgeLines::Surface {
  PrimitiveId id = kNoPrimitive;
  Vec3d corner;
  Vec3d normal;  // unit, towards the eye; 0 for a triangle that double sees as a line

  Surface(const TriangleMesh& mesh, PrimitiveId triangle, const Vec3d& direction)
      : id(triangle), corner(WorldCorner(mesh, triangle, 0)), normal(UnitNormal(mesh, triangle)) {
    if (Dot(normal, direction) > 0) normal = -normal;
  }
  bool Hides(const NearestPoint& point, const Camera& flat) const {
    return Dot(point.world - corner, normal) < -kHiddenBySizePx * flat.PixelSize(point.depth);
  }
};

EdgeLines::EdgeLines(const Scene& scene, const Camera& camera, SidesOfTriangle sides)
    : scene_(scene), camera_(camera), sides_(std::move(sides)) {}

// The opacity of the strongest edge of `triangle` at a point of the image.
float EdgeLines::Strongest(const Camera& flat, double x_px, double y_px, PrimitiveId triangle,
                           const Surface* own) const {
  const TriangleMesh& mesh = *scene_.mesh;
  const std::uint8_t sides = sides_(triangle);
  if (sides == 0) return 0;
  const std::array<Vec3d, 3> corners = {WorldCorner(mesh, triangle, 0),
                                        WorldCorner(mesh, triangle, 1),
                                        WorldCorner(mesh, triangle, 2)};
  double strongest = 0;
  for (unsigned k = 0; k < 3; ++k) {
    if ((sides >> k & 1u) == 0) continue;
    const auto point = Nearest(flat, x_px, y_px, corners[k], corners[(k + 1) % 3]);
    if (!point || point->distance_px >= kReachPx) continue;
    const double coverage = std::min(kReachPx - point->distance_px, 1.0);
    if (coverage <= strongest) continue;
    if (own != nullptr && own->id != triangle && own->Hides(*point, flat)) continue;
    strongest = coverage;
  }
  return static_cast<float>(strongest) * kEdgeOpacity;
}

Result<std::vector<float>> EdgeLines::Draw(const Tile& tile, const TraceOptions& options) const {
  const Tile around = {tile.x0 - 1, tile.y0 - 1, tile.x1 + 1, tile.y1 + 1};
  std::vector<Ray> rays;
  SetCentreRays(camera_, around, &rays);
  std::vector<Hit> hits(rays.size());
  Status status = TraceClosest(scene_, std::span<const Ray>(rays), options, hits);
  if (!status.ok()) return std::move(status).error();

  const auto stride = static_cast<std::size_t>(around.width());
  std::vector<float> opacity(tile.pixel_count());
  CancelPoll poll(options.cancel);
  std::size_t pixel = 0;
  for (int y = tile.y0; y < tile.y1; ++y) {
    for (int x = tile.x0; x < tile.x1; ++x, ++pixel) {
      if (poll.Spend(kPixelWork)) return poll.ToError();
      const std::size_t centre = static_cast<std::size_t>(y - around.y0) * stride +
                                 static_cast<std::size_t>(x - around.x0);
      NearTriangles triangles;
      for (const std::size_t row : {centre - stride, centre, centre + stride}) {
        for (std::size_t i = row - 1; i <= row + 1; ++i) triangles.Add(hits[i].primitive_id);
      }
      if (triangles.begin() == triangles.end()) continue;
      const Camera flat = camera_.FlatAt(x + 0.5, y + 0.5);
      std::optional<Surface> own;
      if (hits[centre].IsHit()) {
        own.emplace(*scene_.mesh, hits[centre].primitive_id, rays[centre].direction);
      }
      for (const PrimitiveId id : triangles) {
        poll.Spend(kTriangleWork);
        opacity[pixel] =
            std::max(opacity[pixel], Strongest(flat, x + 0.5, y + 0.5, id, own ? &*own : nullptr));
      }
    }
  }
  return opacity;
}

}  // namespace kdray::core
