// SPDX-License-Identifier: Apache-2.0
#include "core/render/centre_values.h"

#include <cstdint>
#include <limits>
#include <span>

#include "core/geometry/surface_point.h"
#include "core/render/centre_rays.h"
#include "core/render/pixel_order.h"
#include "core/render/store_ray.h"

namespace kdray::core {
namespace {

// Calls f(x, y, i) for the tile's pixels, in the order of ForEachInPixelOrder.
template <class F>
void ForEachPixel(const Tile& tile, const F& f) {
  std::size_t i = 0;
  ForEachInPixelOrder(tile.width(), tile.height(),
                      [&](int x, int y) { f(tile.x0 + x, tile.y0 + y, i++); });
}

std::int32_t ToInt(std::uint32_t count) {
  constexpr std::uint32_t kLargest = std::numeric_limits<std::int32_t>::max();
  return static_cast<std::int32_t>(std::min(count, kLargest));
}

}  // namespace

void SetCentreRays(const Camera& camera, const Tile& tile, std::vector<Ray>* rays) {
  std::vector<Camera::Column> columns;
  for (int x = tile.x0; x < tile.x1; ++x) columns.push_back(camera.ColumnAt(x + 0.5));
  rays->resize(tile.pixel_count());
  Ray* ray = rays->data();
  for (int y = tile.y0; y < tile.y1; ++y) {
    const Camera::Row row = camera.RowAt(y + 0.5);
    for (const Camera::Column& column : columns) StoreRay(camera.RayThrough(column, row), ray++);
  }
}

Status RenderCentres(const Scene& scene, const TraceOptions& options, const Tile& tile,
                     RenderedImage* image, std::vector<Ray>* rays, std::vector<Hit>* all_hits) {
  rays->resize(tile.pixel_count());
  WriteCentreRays(image->camera, tile, rays->data());
  const auto batch = std::span<const Ray>(*rays);
  std::vector<Hit>& hits = *all_hits;
  hits.resize(rays->size());
  if (image->mode == RenderMode::kCost) {
    std::vector<TraceCost> costs(rays->size());
    Status status = TraceCostly(scene, batch, options, hits, costs);
    if (!status.ok()) return status;
    auto& film = std::get<Film<std::int32_t>>(image->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t i) {
      const std::span<std::int32_t> pixel = film(x, y);
      pixel[0] = ToInt(costs[i].nodes_visited);
      pixel[1] = ToInt(costs[i].triangles_tested);
    });
    return {};
  }
  Status status = TraceClosest(scene, batch, options, hits);
  if (!status.ok()) return status;
  if (image->mode == RenderMode::kDepth) {
    auto& film = std::get<Film<float>>(image->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t i) { film(x, y)[0] = DepthValue(hits[i]); });
  } else if (image->mode == RenderMode::kTriangle) {
    auto& film = std::get<Film<std::int32_t>>(image->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t i) {
      film(x, y)[0] = hits[i].IsHit() ? static_cast<std::int32_t>(hits[i].primitive_id) : -1;
    });
  } else {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    auto& film = std::get<Film<double>>(image->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t i) {
      const Vec3d point =
          hits[i].IsHit() ? SurfacePoint(*scene.mesh, hits[i]) : Vec3d{kNan, kNan, kNan};
      const std::span<double> pixel = film(x, y);
      for (int axis = 0; axis < 3; ++axis) pixel[static_cast<std::size_t>(axis)] = point[axis];
    });
  }
  return {};
}

}  // namespace kdray::core
