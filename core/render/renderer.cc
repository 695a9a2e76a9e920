// SPDX-License-Identifier: Apache-2.0
#include "core/render/renderer.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/render/cell_lines.h"
#include "core/render/centre_values.h"
#include "core/render/picture_precision.h"
#include "core/render/sampled_tiles.h"
#include "core/render/tile_renderer.h"
#include "core/render/tile_scratch.h"

namespace kdray::core {
namespace {

// Samples that are added to a pixel that is still noisy.
constexpr int kAdaptiveStep = 16;

Error Invalid(std::string_view field, std::string message) {
  return Error{.code = ErrorCode::kInvalidArgument, .message = std::move(message), .field = field};
}

bool InUnitRange(const Rgb& c) {
  const auto in_range = [](float v) { return v >= 0.0f && v <= 1.0f; };
  return in_range(c.r) && in_range(c.g) && in_range(c.b);
}

Region RegionOf(const RenderSpec& spec) {
  return spec.region.value_or(Region{0, 0, spec.width, spec.height});
}

Status CheckRange(std::string_view field, int value, int max) {
  if (value >= 1 && value <= max) return {};
  return Invalid(field, "must be 1 to " + std::to_string(max) + ", not " + std::to_string(value));
}

Status CheckRegion(const RenderSpec& spec) {
  const Region r = RegionOf(spec);
  if (!(0 <= r.x0 && r.x0 < r.x1 && r.x1 <= spec.width && 0 <= r.y0 && r.y0 < r.y1 &&
        r.y1 <= spec.height)) {
    return Invalid("region", "must be x0,y0,x1,y1 with x0 < x1 and y0 < y1 within the image");
  }
  if (std::max(r.width(), r.height()) > RenderSpec::kMaxSide) {
    return Invalid("region", "must be at most " + std::to_string(RenderSpec::kMaxSide) +
                                 " pixels a side, not " + std::to_string(r.width()) + " x " +
                                 std::to_string(r.height()));
  }
  return {};
}

Status CheckLights(const RenderSpec& spec) {
  if (spec.ao_radius && !(*spec.ao_radius > 0 && std::isfinite(*spec.ao_radius))) {
    return Invalid("ao_radius", "must be greater than 0");
  }
  if (!spec.lights) return {};
  if (spec.lights->size() > RenderSpec::kMaxLights) {
    return Invalid("lights", "must be at most " + std::to_string(RenderSpec::kMaxLights) +
                                 ", not " + std::to_string(spec.lights->size()));
  }
  for (const Light& light : *spec.lights) {
    if (!IsFinite(light.vector) ||
        (light.kind == LightKind::kDirectional && light.vector == Vec3d{})) {
      return Invalid("lights", "a direction must not be 0, and every number finite");
    }
    if (!(light.intensity >= 0 && std::isfinite(light.intensity))) {
      return Invalid("lights", "an intensity must be at least 0");
    }
    if (!InUnitRange(light.color)) return Invalid("lights", "each part of a color must be 0 to 1");
  }
  return {};
}

Status Check(const RenderSpec& spec) {
  for (const auto& [name, value, max] :
       {std::tuple("width", spec.width, RenderSpec::kMaxWholeSide),
        std::tuple("height", spec.height, RenderSpec::kMaxWholeSide),
        std::tuple("samples", spec.samples.value_or(1), RenderSpec::kMaxSamples),
        std::tuple("max_samples", spec.max_samples, RenderSpec::kMaxSamples)}) {
    if (Status status = CheckRange(name, value, max); !status.ok()) return status;
  }
  if (spec.max_noise && !(*spec.max_noise > 0 && std::isfinite(*spec.max_noise))) {
    return Invalid("max_noise", "must be greater than 0");
  }
  if (spec.budget && spec.budget->count() <= 0) return Invalid("budget_ms", "must be at least 1");
  if (!InUnitRange(spec.color)) return Invalid("color", "each part must be 0 to 1");
  if (spec.background && !InUnitRange(spec.background->color)) {
    return Invalid("background", "each part must be 0 to 1");
  }
  if (Status status = CheckLights(spec); !status.ok()) return status;
  return CheckRegion(spec);
}

// Lines are drawn over light.
bool MakesCodes(const RenderSpec& spec) {
  return spec.as_codes && spec.mode == RenderMode::kShaded && !spec.cells_depth && !spec.edges;
}

Status MakeFilms(const Region& region, const RenderSpec& spec, const CancelToken& cancel,
                 RenderedImage* image) {
  CancelPoll poll(cancel);
  switch (image->mode) {
    case RenderMode::kShaded:
      if (MakesCodes(spec)) {
        image->values = Film<float>(region, 0, &poll);
        image->codes = Film<std::uint8_t>(region, image->background.transparent ? 4 : 3, &poll);
      } else {
        image->values = Film<float>(region, 4, &poll);
      }
      break;
    case RenderMode::kNormal:
      image->values = Film<float>(region, 3, &poll);
      image->coverage = Film<float>(region, 1, &poll);
      break;
    case RenderMode::kAmbientOcclusion:
      image->values = Film<float>(region, 1, &poll);
      image->coverage = Film<float>(region, 1, &poll);
      break;
    case RenderMode::kDepth:
      image->values = Film<float>(region, 1, &poll);
      break;
    case RenderMode::kTriangle:
      image->values = Film<std::int32_t>(region, 1, &poll);
      break;
    case RenderMode::kCost:
      image->values = Film<std::int32_t>(region, 2, &poll);
      break;
    case RenderMode::kPosition:
      image->values = Film<double>(region, 3, &poll);
      break;
  }
  if (image->mode != RenderMode::kShaded) {
    if (spec.cells_depth) image->lines = Film<float>(region, 1, &poll);
    if (spec.edges) image->edges = Film<float>(region, 1, &poll);
  }
  return poll.ToStatus();
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

/// Whether the pixels take 1 or kSmoothSamples, by the colours around them.
bool IsSmoothed(const RenderSpec& spec) {
  return !spec.samples && !spec.max_noise && !spec.budget && !HasOneSample(spec.mode) &&
         spec.mode != RenderMode::kAmbientOcclusion;
}

SamplingRule RuleOf(const RenderSpec& spec) {
  if (HasOneSample(spec.mode)) return {.centre = true};
  if (!spec.max_noise && !spec.budget) {
    return {.limit = spec.samples.value_or(kSmoothSamples), .centre = spec.samples == 1};
  }
  return {.limit = spec.max_samples, .max_noise = spec.max_noise.value_or(0), .estimates = true};
}

/// Side of a tile whose pixels take that many samples at first: some kRaysPerBatch rays, in whole
/// blocks of 8 x 8 pixels (core/render/pixel_order.h).
int TileSide(int samples_at_once) {
  const int side =
      static_cast<int>(std::sqrt(static_cast<double>(kRaysPerBatch) / samples_at_once));
  return std::max(8, side / 8 * 8);
}

// Results of the tiles. The sums do not depend on the order of the tiles.
struct Reached {
  std::uint32_t samples = 0;  // of a pixel, at most
  double noise = 0;
  bool all_below = true;  // max_noise

  void Add(const TileSums& sums, const SamplingRule& rule) {
    for (const PixelSums& pixel : sums.pixels) {
      samples = std::max(samples, pixel.samples);
      if (!rule.estimates) continue;
      const double pixel_noise = pixel.Noise();
      noise = std::max(noise, pixel_noise);
      all_below = all_below && pixel.samples >= kMinAdaptiveSamples && pixel_noise < rule.max_noise;
    }
  }
  void Add(const Reached& other) {
    samples = std::max(samples, other.samples);
    noise = std::max(noise, other.noise);
    all_below = all_below && other.all_below;
  }
};

// Renders tiles into an image. Checks `cancel` once a tile; tracing and drawing within a tile poll
// by themselves.
class ImageRenderer {
 public:
  ImageRenderer(const RenderSpec& spec, const SamplingRule& rule, const SampledTiles& renderer,
                const CancelToken& cancel, Progress* progress)
      : spec_(spec), rule_(rule), renderer_(renderer), cancel_(cancel), progress_(progress) {}

  Status RenderCentres(const TileRenderer& renderer, const Region& region) const {
    const TileGrid tiles(region, TileSide(1));
    return ForEachTile(tiles.size(),
                       [&](std::size_t i) { return renderer.RenderCentres(tiles[i]); });
  }

  // The centres of a mode that may take several samples.
  Status RenderOneSample(const Region& region) const {
    const TileGrid tiles(region, TileSide(1));
    return ForEachTile(tiles.size(),
                       [&](std::size_t i) { return renderer_.RenderCentres(tiles[i]); });
  }

  // Tile by tile, by the default rule.
  Status RenderSmooth(const Region& region, RenderedImage* image) const {
    const TileGrid tiles(region, kSmoothTileSide);
    SharedReached reached;
    Status status = ForEachTile(tiles.size(), [&](std::size_t i) -> Status {
      TileSums sums = SampledTiles::Begin(tiles[i]);
      if (Status smooth = renderer_.RenderSmooth(&sums); !smooth.ok()) return smooth;
      renderer_.Write(sums);
      reached.Add(sums, rule_);
      return {};
    });
    if (status.ok()) Report(reached.all, image);
    return status;
  }

  // Tile by tile, each until its pixels have enough samples.
  Status RenderTiles(const Region& region, RenderedImage* image) const {
    const int first = spec_.max_noise ? std::min(kMinAdaptiveSamples, rule_.limit) : rule_.limit;
    const TileGrid tiles(region, TileSide(first));
    SharedReached reached;
    Status status = ForEachTile(tiles.size(), [&](std::size_t i) -> Status {
      TileSums sums = SampledTiles::Begin(tiles[i]);
      int target = first;
      do {
        if (cancel_.ShouldStop()) return cancel_.ToError();
        if (Status refined = renderer_.Refine(target, &sums); !refined.ok()) return refined;
        target = std::min(target + kAdaptiveStep, rule_.limit);
      } while (!sums.is_finished());
      renderer_.Write(sums);
      reached.Add(sums, rule_);
      return {};
    });
    if (status.ok()) Report(reached.all, image);
    return status;
  }

  // All tiles together, in passes, until the time has passed.
  Status RenderWithin(std::chrono::steady_clock::time_point end, const Region& region,
                      bool has_lines, RenderedImage* image) const {
    const TileGrid tiles(region, TileSide(kAdaptiveStep));
    std::vector<TileSums> sums;
    sums.reserve(tiles.size());
    CancelPoll poll(cancel_);
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      if (poll.Spend(kSumsWork * tiles[i].pixel_count())) return poll.ToError();
      sums.push_back(SampledTiles::Begin(tiles[i]));
    }
    std::atomic<bool> is_over{false};
    // Lines use the depths of the first samples; one sample would be too coarse.
    const int first = std::min(has_lines ? kMinAdaptiveSamples : 1, rule_.limit);
    for (int target = first; !is_over; target = NextTarget(target)) {
      std::atomic<bool> is_finished{true};
      Status status = ForEachTile(sums.size(), [&](std::size_t i) -> Status {
        if (sums[i].is_finished()) return {};
        if (target != first && std::chrono::steady_clock::now() >= end) {
          is_over = true;
          return {};
        }
        is_finished = false;
        return renderer_.Refine(target, &sums[i]);
      });
      if (!status.ok()) return status;
      if (is_finished) break;
    }
    SharedReached reached;
    Status status = ForEachTile(sums.size(), [&](std::size_t i) -> Status {
      renderer_.Write(sums[i]);
      reached.Add(sums[i], rule_);
      return {};
    });
    if (!status.ok()) return status;
    Report(reached.all, image);
    if (is_over) image->stopped = Stopped::kBudget;
    return {};
  }

  // Draws lines over the finished image.
  Status DrawEdges(const EdgeLines& edges, const TraceOptions& options, const Region& region,
                   RenderedImage* image) const {
    const TileGrid tiles(region, TileSide(1));
    const Rgb linear = SrgbToLinear(kEdgeColor);
    const Rgba line = {linear.r, linear.g, linear.b, 1.0f};
    return ForEachTile(tiles.size(), [&](std::size_t i) -> Status {
      const Tile tile = tiles[i];
      const Result<std::vector<float>> drawn = edges.Draw(tile, options);
      if (!drawn.ok()) return drawn.error();
      auto opacity = drawn->begin();
      for (int y = tile.y0; y < tile.y1; ++y) {
        for (int x = tile.x0; x < tile.x1; ++x, ++opacity) {
          if (image->edges) {
            (*image->edges)(x, y)[0] = *opacity;
          } else if (*opacity > 0) {
            const std::span<float> c = std::get<Film<float>>(image->values)(x, y);
            const Rgba over = Over(line * *opacity, {c[0], c[1], c[2], c[3]});
            c[0] = over.r;
            c[1] = over.g;
            c[2] = over.b;
            c[3] = over.a;
          }
        }
      }
      return {};
    });
  }

 private:
  // Work (CancelPoll) of allocating a pixel's sums.
  static constexpr std::uint64_t kSumsWork = 32;

  // Of all tiles so far. Safe from many threads at once.
  struct SharedReached {
    std::mutex mutex;
    Reached all;

    void Add(const TileSums& sums, const SamplingRule& rule) {
      Reached tile;
      tile.Add(sums, rule);
      const std::lock_guard lock(mutex);
      all.Add(tile);
    }
  };

  template <class F>
  Status ForEachTile(std::size_t count, const F& f) const {
    // Bounds the number of pieces, because each takes some time even after an error.
    constexpr std::size_t kMostPieces = std::size_t{1} << 16;
    FirstError first_error;
    ParallelFor(0, count, count / kMostPieces + 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        if (first_error.seen()) return;
        if (cancel_.ShouldStop()) return first_error.Set(cancel_.ToError());
        if (Status status = f(i); !status.ok()) return first_error.Set(std::move(status).error());
        if (progress_ != nullptr && !spec_.budget) {
          progress_->Add(1.0 / static_cast<double>(count));
        }
      }
    });
    if (std::optional<Error> error = std::move(first_error).Take()) return *std::move(error);
    return {};
  }

  int NextTarget(int target) const {
    return std::min(target < kAdaptiveStep ? 2 * target : target + kAdaptiveStep, rule_.limit);
  }

  void Report(const Reached& all, RenderedImage* image) const {
    image->samples = static_cast<int>(all.samples);
    if (std::isfinite(all.noise) && rule_.estimates) image->noise = all.noise;
    if (spec_.max_noise && all.all_below) image->stopped = Stopped::kNoise;
  }

  const RenderSpec& spec_;
  const SamplingRule& rule_;
  const SampledTiles& renderer_;
  const CancelToken& cancel_;
  Progress* const progress_;
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
  image.precision =
      spec.precision ? *spec.precision : PicturePrecision(*scene.mesh, image.camera, cancel);
  image.bounds = scene.mesh->bounds();
  const bool shows_light =
      spec.mode == RenderMode::kShaded || spec.mode == RenderMode::kAmbientOcclusion;
  const Background default_background = {.color = shows_light ? Rgb{1, 1, 1} : Rgb{0, 0, 0}};
  image.background = spec.background.value_or(default_background);
  const Region region = RegionOf(spec);
  if (Status films = MakeFilms(region, spec, cancel, &image); !films.ok()) {
    return std::move(films).error();
  }

  const SamplingRule rule = RuleOf(spec);
  const TraceOptions trace_options = {.precision = image.precision, .cancel = cancel};
  ScratchPool pool;
  TileRenderer renderer(scene, trace_options, &pool, &image);
  if (spec.cells_depth) {
    Result<std::vector<TreeCell>> cells = scene.Cells(*spec.cells_depth, spec.max_cells, cancel);
    if (!cells.ok()) {
      Error error = std::move(cells).error();
      if (error.code == ErrorCode::kInvalidArgument) error.field = "cells_depth";
      return error;
    }
    renderer.SetLines(CellLines(*cells, image.camera, region, LineStyle{}, cancel));
    if (cancel.ShouldStop()) return cancel.ToError();
  }

  const SampledTiles sampled(scene, spec, rule, trace_options, renderer, &pool, &image);
  const ImageRenderer image_renderer(spec, rule, sampled, cancel, progress);
  Status status;
  if (HasOneSample(spec.mode)) {
    status = image_renderer.RenderCentres(renderer, region);
  } else if (rule.centre) {
    status = image_renderer.RenderOneSample(region);
  } else if (IsSmoothed(spec)) {
    status = image_renderer.RenderSmooth(region, &image);
  } else if (spec.budget) {
    status = image_renderer.RenderWithin(std::chrono::steady_clock::now() + *spec.budget, region,
                                         spec.cells_depth.has_value(), &image);
  } else {
    status = image_renderer.RenderTiles(region, &image);
  }
  if (status.ok() && spec.edges) {
    const EdgeLines edges(scene, image.camera, *spec.edges);
    status = image_renderer.DrawEdges(edges, trace_options, region, &image);
  }
  if (!status.ok()) return std::move(status).error();
  if (progress != nullptr) progress->Finish();
  image.counts = pool.Counts();
  return image;
}

}  // namespace kdray::core
