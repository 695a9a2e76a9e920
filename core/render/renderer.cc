#include "core/render/renderer.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/render/cell_lines.h"
#include "core/render/sampler.h"
#include "core/render/shading.h"
#include "core/trace/trace.h"

namespace kdray::core {
namespace {

// Rays of one batch: enough for engines that take coherent rays together, few enough to stay in
// the second-level cache with their hits.
constexpr int kRaysPerTile = 4096;

Error Invalid(std::string message) {
  return Error{ErrorCode::kInvalidArgument, std::move(message)};
}

bool InUnitRange(const Rgb& c) {
  const auto in_range = [](float v) { return v >= 0.0f && v <= 1.0f; };
  return in_range(c.r) && in_range(c.g) && in_range(c.b);
}

Status Check(const RenderSpec& spec) {
  const auto side_is_valid = [](int side) { return side >= 1 && side <= RenderSpec::kMaxSide; };
  if (!side_is_valid(spec.width)) return Invalid("width: must be 1 to 16384");
  if (!side_is_valid(spec.height)) return Invalid("height: must be 1 to 16384");
  if (spec.samples < 1 || spec.samples > RenderSpec::kMaxSamples) {
    return Invalid("samples: must be 1 to 65536");
  }
  if (!InUnitRange(spec.color)) return Invalid("color: each part must be 0 to 1");
  if (spec.background && !InUnitRange(spec.background->color)) {
    return Invalid("background: each part must be 0 to 1");
  }
  if (spec.region) {
    const Region& r = *spec.region;
    if (!(0 <= r.x0 && r.x0 < r.x1 && r.x1 <= spec.width && 0 <= r.y0 && r.y0 < r.y1 &&
          r.y1 <= spec.height)) {
      return Invalid("region: must be x0,y0,x1,y1 with x0 < x1 and y0 < y1 within the image");
    }
  }
  return {};
}

// Everything the tiles share. Tiles write to different pixels of the films.
class TileRenderer {
 public:
  TileRenderer(const Scene& scene, const RenderSpec& spec, const CancelToken& cancel,
               RenderedImage* image)
      : mesh_(*scene.mesh),
        scene_(scene),
        seed_(spec.seed),
        samples_(HasOneSample(spec.mode) ? 1 : spec.samples),
        trace_options_{.precision = spec.precision, .cancel = cancel},
        color_(SrgbToLinear(spec.color)),
        image_(image) {
    const Background& background = image->background;
    if (!background.transparent) {
      const Rgb linear = SrgbToLinear(background.color);
      background_ = {linear.r, linear.g, linear.b, 1.0f};
    }
  }

  void SetLines(CellLines lines) {
    const Rgb linear = SrgbToLinear(lines.style().color);
    line_color_ = {linear.r, linear.g, linear.b, 1.0f};
    lines_ = std::move(lines);
  }

  /// Side of a square tile of at most kRaysPerTile rays, or 1.
  int TileSide() const {
    return std::max(1, static_cast<int>(std::sqrt(static_cast<double>(kRaysPerTile) / samples_)));
  }

  Status Render(const Tile& tile) const {
    const std::vector<Ray> rays = MakeRays(tile);
    std::vector<Hit> hits(rays.size());
    if (Status status = TraceClosest(scene_, std::span<const Ray>(rays), trace_options_, hits);
        !status.ok()) {
      return status;
    }
    switch (image_->mode) {
      case RenderMode::kShaded:
        Shade(tile, rays, hits);
        break;
      case RenderMode::kNormal:
        WriteNormals(tile, hits);
        break;
      case RenderMode::kDepth:
        WriteDepths(tile, hits);
        break;
      case RenderMode::kTriangle:
        WriteTriangles(tile, hits);
        break;
    }
    if (lines_) DrawLines(tile, hits);
    return {};
  }

  static bool HasOneSample(RenderMode mode) {
    return mode == RenderMode::kDepth || mode == RenderMode::kTriangle;
  }

 private:
  // Rays of pixel 0's samples, pixel 1's, …, pixels row by row.
  std::vector<Ray> MakeRays(const Tile& tile) const {
    std::vector<Ray> rays;
    rays.reserve(tile.pixel_count() * static_cast<std::size_t>(samples_));
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        if (samples_ == 1) {
          rays.push_back(image_->camera.RayThrough(x + 0.5, y + 0.5));
          continue;
        }
        const PixelSampler sampler(seed_, x, y);
        for (int i = 0; i < samples_; ++i) {
          const SamplePosition at = sampler[static_cast<std::uint32_t>(i)];
          rays.push_back(image_->camera.RayThrough(x + at.x, y + at.y));
        }
      }
    }
    return rays;
  }

  // Calls f(x, y, first) for each pixel, whose samples are first … first + samples_ - 1.
  template <class F>
  void ForEachPixel(const Tile& tile, const F& f) const {
    std::size_t first = 0;
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x) {
        f(x, y, first);
        first += static_cast<std::size_t>(samples_);
      }
    }
  }

  void Shade(const Tile& tile, std::span<const Ray> rays, std::span<const Hit> hits) const {
    auto& film = std::get<Film<float>>(image_->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t first) {
      // Light and misses are summed apart: the mesh has one colour, the background another.
      float light = 0;
      int misses = 0;
      for (std::size_t i = first; i < first + static_cast<std::size_t>(samples_); ++i) {
        if (hits[i].IsHit()) {
          light += HeadlightCosine(UnitNormal(mesh_, hits[i].primitive_id), rays[i].direction);
        } else {
          ++misses;
        }
      }
      const float per_sample = 1.0f / static_cast<float>(samples_);
      const float lit = light * per_sample;
      const float missed = static_cast<float>(misses) * per_sample;
      const Rgba surface = {color_.r * lit, color_.g * lit, color_.b * lit, 1.0f - missed};
      const Rgba behind = background_ * missed;
      Store(film(x, y), {surface.r + behind.r, surface.g + behind.g, surface.b + behind.b,
                         background_.a == 1.0f ? 1.0f : surface.a});
    });
  }

  void WriteNormals(const Tile& tile, std::span<const Hit> hits) const {
    auto& film = std::get<Film<float>>(image_->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t first) {
      Vec3d sum;
      int hit_count = 0;
      for (std::size_t i = first; i < first + static_cast<std::size_t>(samples_); ++i) {
        if (!hits[i].IsHit()) continue;
        sum = sum + UnitNormal(mesh_, hits[i].primitive_id);
        ++hit_count;
      }
      const Vec3f mean(sum * (1.0 / samples_));
      const std::span<float> pixel = film(x, y);
      pixel[0] = mean.x;
      pixel[1] = mean.y;
      pixel[2] = mean.z;
      (*image_->coverage)(x, y)[0] = static_cast<float>(hit_count) / static_cast<float>(samples_);
    });
  }

  void WriteDepths(const Tile& tile, std::span<const Hit> hits) const {
    constexpr double kLargest = std::numeric_limits<float>::max();
    auto& film = std::get<Film<float>>(image_->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t first) {
      const Hit& hit = hits[first];
      film(x, y)[0] = hit.IsHit() ? static_cast<float>(std::min(hit.t, kLargest))
                                  : std::numeric_limits<float>::infinity();
    });
  }

  void WriteTriangles(const Tile& tile, std::span<const Hit> hits) const {
    auto& film = std::get<Film<std::int32_t>>(image_->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t first) {
      const Hit& hit = hits[first];
      film(x, y)[0] = hit.IsHit() ? static_cast<std::int32_t>(hit.primitive_id) : -1;
    });
  }

  void DrawLines(const Tile& tile, std::span<const Hit> hits) const {
    std::vector<float> opacity(tile.pixel_count());
    lines_->Draw(tile, hits, samples_, opacity);
    std::size_t pixel = 0;
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int x = tile.x0; x < tile.x1; ++x, ++pixel) {
        if (image_->lines) {
          (*image_->lines)(x, y)[0] = opacity[pixel];
        } else if (opacity[pixel] > 0.0f) {
          const std::span<float> under = std::get<Film<float>>(image_->values)(x, y);
          Store(under,
                Over(line_color_ * opacity[pixel], {under[0], under[1], under[2], under[3]}));
        }
      }
    }
  }

  static void Store(std::span<float> pixel, const Rgba& c) {
    pixel[0] = c.r;
    pixel[1] = c.g;
    pixel[2] = c.b;
    pixel[3] = c.a;
  }

  const TriangleMesh& mesh_;
  const Scene& scene_;
  std::uint64_t seed_;
  int samples_;
  TraceOptions trace_options_;
  Rgb color_;        // linear
  Rgba background_;  // linear; all 0 when transparent
  Rgba line_color_;  // linear
  std::optional<CellLines> lines_;
  RenderedImage* image_;
};

void MakeFilms(const Region& region, bool with_lines, RenderedImage* image) {
  switch (image->mode) {
    case RenderMode::kShaded:
      image->values = Film<float>(region, 4);
      break;
    case RenderMode::kNormal:
      image->values = Film<float>(region, 3);
      image->coverage = Film<float>(region, 1);
      break;
    case RenderMode::kDepth:
      image->values = Film<float>(region, 1);
      break;
    case RenderMode::kTriangle:
      image->values = Film<std::int32_t>(region, 1);
      break;
  }
  if (with_lines && image->mode != RenderMode::kShaded) image->lines = Film<float>(region, 1);
}

// The first failure of any tile; the others stop soon after it.
class FirstError {
 public:
  bool seen() const { return seen_.load(std::memory_order_relaxed); }
  void Set(Error error) {
    const std::lock_guard lock(mutex_);
    if (!error_) error_ = std::move(error);
    seen_.store(true, std::memory_order_relaxed);
  }
  std::optional<Error> Take() && { return std::move(error_); }

 private:
  std::atomic<bool> seen_{false};
  std::mutex mutex_;
  std::optional<Error> error_;
};

}  // namespace

Result<RenderedImage> Render(const Scene& scene, const RenderSpec& spec, const CancelToken& cancel,
                             Progress* progress) {
  if (Status status = Check(spec); !status.ok()) return std::move(status).error();
  Result<Camera> camera = ResolveCamera(spec.camera, scene.mesh->bounds(), spec.width, spec.height);
  if (!camera.ok()) return std::move(camera).error();

  RenderedImage image;
  image.mode = spec.mode;
  image.camera = *std::move(camera);
  image.bounds = scene.mesh->bounds();
  const Background default_background = {.color = spec.mode == RenderMode::kShaded ? Rgb{1, 1, 1}
                                                                                   : Rgb{0, 0, 0}};
  image.background = spec.background.value_or(default_background);
  const Region region = spec.region.value_or(Region{0, 0, spec.width, spec.height});
  MakeFilms(region, spec.cells_depth.has_value(), &image);

  TileRenderer renderer(scene, spec, cancel, &image);
  if (spec.cells_depth) {
    Result<std::vector<TreeCell>> cells = scene.Cells(*spec.cells_depth, RenderSpec::kMaxCells);
    if (!cells.ok()) {
      Error error = std::move(cells).error();
      if (error.code == ErrorCode::kInvalidArgument) {
        error.message = "cells_depth: " + error.message;
      }
      return error;
    }
    renderer.SetLines(CellLines(*cells, image.camera, region));
  }

  const std::vector<Tile> tiles = CutIntoTiles(region, renderer.TileSide());
  FirstError first_error;
  ParallelFor(0, tiles.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      if (first_error.seen()) return;
      if (cancel.ShouldStop()) return first_error.Set(cancel.ToError());
      if (Status status = renderer.Render(tiles[i]); !status.ok()) {
        return first_error.Set(std::move(status).error());
      }
      if (progress != nullptr) progress->Add(1.0 / static_cast<double>(tiles.size()));
    }
  });
  if (std::optional<Error> error = std::move(first_error).Take()) return *std::move(error);
  if (progress != nullptr) progress->Finish();
  return image;
}

}  // namespace kdray::core
