// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/embree_picture.h"

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <span>
#include <variant>

#include "core/base/parallel.h"
#include "core/render/camera_rays.h"
#include "core/render/film.h"
#include "core/render/shader.h"
#include "core/render/tile_scratch.h"
#include "core/trace/trace.h"

namespace kdray::bench {

using core::Film;
using core::RayF;

core::RenderSpec PictureOf(const BenchView& view, int side) {
  core::RenderSpec spec;
  spec.width = spec.height = side;
  spec.camera.eye = view.eye;
  spec.camera.target = view.target;
  spec.camera.up = view.up;
  spec.camera.fov_deg = 2 * std::atan(view.half_width) * 180 / std::numbers::pi;
  return spec;
}

double EmbreePicture::Run(int threads) {
  constexpr int kTileSide = 64;
  const Stopwatch watch(threads);
  const core::Shader shader(scene_, spec_, core::TraceOptions{image_.precision, {}});
  const core::CameraRays camera(image_.camera);
  const core::Rgb background = core::SrgbToLinear(
      {image_.background.color.r, image_.background.color.g, image_.background.color.b});
  const core::Region region{0, 0, spec_.width, spec_.height};
  Film<float> film(region, 4);
  core::ScratchPool pool;
  const core::TileGrid tiles(region, kTileSide);
  core::ParallelFor(0, tiles.size(), 1, [&](std::size_t number, std::size_t) {
    const core::Tile tile = tiles[number];
    const core::ScratchPool::Lease lease(&pool);
    core::TileScratch& scratch = *lease.get();
    const auto width = static_cast<std::uint32_t>(tile.width());
    const auto& order = scratch.OrderOf(tile.width(), tile.height());
    const auto x_of = [&](std::uint32_t pixel) {
      return tile.x0 + static_cast<int>(pixel % width);
    };
    const auto y_of = [&](std::uint32_t pixel) {
      return tile.y0 + static_cast<int>(pixel / width);
    };
    for (std::size_t i = 0; i < order.size(); ++i) {
      const core::CameraRays::AroundInFloat around(camera, x_of(order[i]) + 0.5,
                                                   y_of(order[i]) + 0.5);
      around.Write(0, 0, &scratch.float_rays[i]);
    }
    const std::span<const RayF> rays(scratch.float_rays.data(), order.size());
    scratch.hits.resize(rays.size());
    TraceRows(embree_, way_, coherent_, rays, scratch.hits);
    if (!shader.Shade(rays, &scratch).ok()) std::exit(1);
    for (std::size_t i = 0; i < order.size(); ++i) {
      const std::span<float> pixel = film(x_of(order[i]), y_of(order[i]));
      const bool is_hit = scratch.hits[i].IsHit();
      pixel[0] = is_hit ? scratch.values[i].x : background.r;
      pixel[1] = is_hit ? scratch.values[i].y : background.g;
      pixel[2] = is_hit ? scratch.values[i].z : background.b;
      pixel[3] = 1;
    }
  });
  const double seconds = watch.seconds();
  film_ = std::move(film);
  return seconds;
}

double EmbreePicture::Difference() const {
  const std::span<const float> ours = std::get<Film<float>>(image_.values).values();
  const std::span<const float> theirs = film_.values();
  std::size_t differ = 0;
  for (std::size_t i = 0; i < ours.size(); i += 4) {
    bool same = true;
    for (std::size_t k = 0; k < 3; ++k)
      same = same && std::fabs(ours[i + k] - theirs[i + k]) <= 1.0f / 256;
    differ += same ? 0 : 1;
  }
  return static_cast<double>(differ) / static_cast<double>(ours.size() / 4);
}

}  // namespace kdray::bench
