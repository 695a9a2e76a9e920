// SPDX-License-Identifier: Apache-2.0
#include "core/render/sampled_tiles.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/render/centre_rays.h"
#include "core/render/pixel_filter.h"
#include "core/render/pixel_order.h"
#include "core/render/sampler.h"
#include "core/render/srgb_codes.h"
#include "core/render/store_ray.h"

namespace kdray::core {
namespace {

// Two colours that differ by less in each channel, as displayed, make no visible steps along a
// border between them: 1/20 of the range.
constexpr float kVisibleStep = 0.05f;

// About the share of the display's range that linear light takes.
float Displayed(float linear) { return std::sqrt(std::clamp(linear, 0.0f, 1.0f)); }

// Whether two pixels show different things (TileScratch::Look).
bool Differ(const FourFloats& a, const FourFloats& b) {
  const FourFloats distance = a - b;
  const FourInts above = (distance > kVisibleStep) | (distance < -kVisibleStep);
  return (above[0] | above[1] | above[2] | above[3]) != 0;
}

FourFloats LightOf(const Rgba& c) { return FourFloats{c.r, c.g, c.b, c.a}; }

float ToFloat(double light) {
  return static_cast<float>(
      std::min(light, static_cast<double>(std::numeric_limits<float>::max())));
}

// Calls f(dx, dy) with the distances of the samples [first, first + count) from the pixel's centre,
// in pixels.
template <class F>
void ForEachOffset(const PixelSampler& sampler, std::uint32_t first, std::uint32_t count,
                   const F& f) {
  const PixelFilter& filter = PixelFilter::Get();
  const std::uint32_t end = first + count;
  std::uint32_t n = first;
  const auto single = [&] {
    const SampleWords at = sampler[n++];
    f(filter.Offset(at.x), filter.Offset(at.y));
  };
  if (n % 2 != 0 && n < end) single();
  for (; n + 1 < end; n += 2) {
    const FourFloats at = filter.Offsets(sampler.Two(n));
    f(at[0], at[1]);
    f(at[2], at[3]);
  }
  if (n < end) single();
}

}  // namespace

SampledTiles::SampledTiles(const Scene& scene, const RenderSpec& spec, const SamplingRule& rule,
                           const TraceOptions& trace_options, const TileRenderer& lines,
                           ScratchPool* pool, RenderedImage* image)
    : scene_(scene),
      mode_(spec.mode),
      seed_(spec.seed),
      rule_(rule),
      trace_options_(trace_options),
      rays_(image->camera),
      // `fast` and `watertight` compute in float anyway.
      float_rays_(!rule.centre &&
                  (trace_options.precision == Precision::kFast ||
                   trace_options.precision == Precision::kWatertight) &&
                  rays_.FitFloat(image->bounds)),
      shader_(scene, spec, trace_options),
      lines_(lines),
      pool_(pool),
      codes_(SrgbCodes::Table()),
      image_(image) {
  if (!image->background.transparent) {
    const Rgb linear = SrgbToLinear(image->background.color);
    background_ = {linear.r, linear.g, linear.b, 1.0f};
  }
  const FourFloats behind = LightOf(background_);
  std::array<float, 4> channels;
  __builtin_memcpy(channels.data(), &behind, sizeof(behind));
  EncodeLight<4>(codes_, channels.data(), background_codes_.data());
  background_luminance_ =
      mode_ == RenderMode::kNormal ? 0.0 : LuminanceOf(background_.r, background_.g, background_.b);
}

TileSums SampledTiles::Begin(const Tile& tile) {
  return {.tile = tile,
          .pixels = std::vector<PixelSums>(tile.pixel_count()),
          .line_opacity = {},
          .line_hits = {}};
}

// Appends the samples [first, first + count) of a pixel to the rays.
void SampledTiles::AddRays(const Tile& tile, std::uint32_t pixel, std::uint32_t first,
                           std::uint32_t count, TileScratch* scratch) const {
  const auto width = static_cast<std::uint32_t>(tile.width());
  const int x = tile.x0 + static_cast<int>(pixel % width);
  const int y = tile.y0 + static_cast<int>(pixel / width);
  const std::size_t begin = scratch->ray_count;
  scratch->ray_count += count;
  const PixelSampler sampler(seed_, x, y);
  if (shader_.needs_directions()) {
    for (std::uint32_t n = first; n < first + count; ++n) {
      scratch->directions.push_back(sampler.Direction(n));
    }
  }
  if (float_rays_) {
    const CameraRays::AroundInFloat around(rays_, x + 0.5, y + 0.5);
    RayF* ray = scratch->float_rays.data() + begin;
    ForEachOffset(sampler, first, count, [&](float dx, float dy) { around.Write(dx, dy, ray++); });
    return;
  }
  const CameraRays::Around around(rays_, x + 0.5, y + 0.5);
  Ray* ray = scratch->rays.data() + begin;
  ForEachOffset(sampler, first, count, [&](float dx, float dy) {
    StoreRay(around.At(static_cast<double>(dx), static_cast<double>(dy)), ray++);
  });
}

Status SampledTiles::Trace(const RayBatch& rays, TileScratch* scratch) const {
  scratch->hits.resize(rays.size());
  scratch->counts.camera_rays += rays.size();
  return TraceClosest(scene_, rays, trace_options_, scratch->hits);
}

// Closest hits and values of the centres of the tile's pixels, in the order of
// ForEachInPixelOrder.
Status SampledTiles::TraceCentres(const Tile& tile, TileScratch* scratch) const {
  WriteCentreRays(image_->camera, tile, scratch->rays.data());
  if (shader_.needs_directions()) {
    scratch->directions.clear();
    ForEachInPixelOrder(tile.width(), tile.height(), [&](int x, int y) {
      scratch->directions.push_back(PixelSampler(seed_, tile.x0 + x, tile.y0 + y).Direction(0));
    });
  }
  const auto rays = std::span<const Ray>(scratch->rays).first(tile.pixel_count());
  if (Status status = Trace(rays, scratch); !status.ok()) return status;
  return shader_.Shade(rays, scratch);
}

Status SampledTiles::RenderCentres(const Tile& tile) const {
  const ScratchPool::Lease lease(pool_);
  TileScratch* const scratch = lease.get();
  if (Status status = TraceCentres(tile, scratch); !status.ok()) return status;
  if (mode_ == RenderMode::kShaded) {
    WriteShadedCentres(tile, *scratch);
  } else {
    std::size_t i = 0;
    ForEachInPixelOrder(tile.width(), tile.height(), [&](int x, int y) {
      PixelSums pixel;
      pixel.samples = 1;
      pixel.misses = scratch->hits[i].IsHit() ? 0 : 1;
      pixel.sum = Vec3d(scratch->values[i++]);
      WritePixel(pixel, tile.x0 + x, tile.y0 + y);
    });
  }
  return lines_.draws_lines() ? lines_.DrawLines(tile, scratch->hits) : Status();
}

// As WriteShaded does for the sums of one sample.
void SampledTiles::WriteShadedCentres(const Tile& tile, const TileScratch& scratch) const {
  const Hit* hit = scratch.hits.data();
  const Vec3f* value = scratch.values.data();
  ForEachInPixelOrder(tile.width(), tile.height(), [&](int x, int y) {
    if (hit->IsHit()) {
      // Never -0.
      const FourFloats lit = FourFloats{value->x, value->y, value->z, 1} + 0.0f;
      StoreLight(lit, tile.x0 + x, tile.y0 + y);
    } else if (image_->codes) {
      const std::span<std::uint8_t> pixel = (*image_->codes)(tile.x0 + x, tile.y0 + y);
      std::copy_n(background_codes_.begin(), pixel.size(), pixel.begin());
    } else {
      StoreLight(LightOf(background_), tile.x0 + x, tile.y0 + y);
    }
    ++hit;
    ++value;
  });
}

Status SampledTiles::Refine(int target, TileSums* sums) const {
  const ScratchPool::Lease lease(pool_);
  TileScratch* const scratch = lease.get();
  std::vector<Run> runs;
  const auto begin_batch = [&] {
    scratch->ray_count = 0;
    scratch->directions.clear();
    runs.clear();
  };
  begin_batch();
  const auto all = static_cast<std::uint32_t>(target);
  if (lines_.draws_lines() && sums->line_opacity.empty()) {
    sums->line_hits.resize(sums->pixels.size() * static_cast<std::size_t>(target));
  }
  for (const std::uint32_t i : scratch->OrderOf(sums->tile.width(), sums->tile.height())) {
    const PixelSums& pixel = sums->pixels[i];
    if (pixel.stopped) continue;
    for (std::uint32_t n = pixel.samples; n < all;) {
      const auto room = static_cast<std::uint32_t>(kRaysPerBatch - scratch->ray_count);
      const std::uint32_t count = std::min(all - n, room);
      AddRays(sums->tile, i, n, count, scratch);
      runs.push_back({i, count});
      n += count;
      if (scratch->ray_count < kRaysPerBatch) continue;
      if (Status status = FinishBatch(target, runs, scratch, sums); !status.ok()) return status;
      begin_batch();
    }
  }
  if (!runs.empty()) {
    if (Status status = FinishBatch(target, runs, scratch, sums); !status.ok()) return status;
  }
  if (!sums->line_hits.empty()) {
    // From the first samples, of which all pixels have the same number: their depths are accurate
    // enough for a line's edge.
    if (Status status = DrawLines(target, sums->line_hits, sums); !status.ok()) return status;
    sums->line_hits = {};
  }
  for (PixelSums& pixel : sums->pixels) {
    pixel.stopped = pixel.stopped || target >= rule_.limit ||
                    (target >= kMinAdaptiveSamples && pixel.Noise() < rule_.max_noise);
  }
  return {};
}

Status SampledTiles::FinishBatch(int target, std::span<const Run> runs, TileScratch* scratch,
                                 TileSums* sums) const {
  const std::size_t ray_count = scratch->ray_count;
  const RayBatch rays = float_rays_
                            ? RayBatch(std::span<const RayF>(scratch->float_rays).first(ray_count))
                            : RayBatch(std::span<const Ray>(scratch->rays).first(ray_count));
  if (Status status = Trace(rays, scratch); !status.ok()) return status;
  if (Status status = shader_.Shade(rays, scratch); !status.ok()) return status;
  const Hit* hit = scratch->hits.data();
  const Vec3f* value = scratch->values.data();
  for (const Run& run : runs) {
    PixelSums& pixel = sums->pixels[run.pixel];
    if (!sums->line_hits.empty()) {
      const std::size_t first = run.pixel * static_cast<std::size_t>(target) + pixel.samples;
      std::copy_n(hit, run.count, sums->line_hits.begin() + static_cast<std::ptrdiff_t>(first));
    }
    Vec3d sum = pixel.sum;
    std::uint32_t hit_count = 0;
    for (std::uint32_t k = 0; k < run.count; ++k) {
      sum = sum + Vec3d(value[k]);
      hit_count += hit[k].IsHit() ? 1 : 0;
    }
    pixel.sum = sum;
    pixel.misses += run.count - hit_count;
    for (std::uint32_t k = 0; rule_.estimates && k < run.count; ++k) {
      pixel.AddLuminance(hit[k].IsHit() ? shader_.LuminanceOf(value[k]) : background_luminance_);
    }
    pixel.samples += run.count;
    hit += run.count;
    value += run.count;
  }
  return {};
}

Status SampledTiles::DrawLines(int samples, std::span<const Hit> hits, TileSums* sums) const {
  sums->line_opacity.resize(sums->pixels.size());
  return lines_.FindLines(sums->tile, hits, samples, sums->line_opacity);
}

// Sets scratch->is_step: whether one of the eight pixels around shows another thing, or a visibly
// different colour. Of the tile's outermost pixels only the neighbours within the tile count.
void SampledTiles::FindSteps(const Tile& tile, TileScratch* scratch) const {
  const auto width = static_cast<std::size_t>(tile.width());
  const auto height = static_cast<std::size_t>(tile.height());
  std::vector<TileScratch::Look>& looks = scratch->looks;
  looks.resize(width * height);
  const Hit* hit = scratch->hits.data();
  const Vec3f* value = scratch->values.data();
  ForEachInPixelOrder(tile.width(), tile.height(), [&](int x, int y) {
    const auto displayed = [&](float v) {
      return mode_ == RenderMode::kNormal ? 0.5f * v : Displayed(v);
    };
    const float is_hit = hit++->IsHit() ? 1.0f : 0.0f;
    const Vec3f& v = *value++;
    looks[static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)] = {
        FourFloats{displayed(v.x), displayed(v.y), displayed(v.z), is_hit}};
  });
  std::vector<std::uint8_t>& is_step = scratch->is_step;
  is_step.assign(looks.size(), 0);
  // Each pair of neighbours once.
  const auto compare = [&](std::size_t a, std::size_t b) {
    const std::uint8_t differ = Differ(looks[a].channels, looks[b].channels) ? 1 : 0;
    is_step[a] |= differ;
    is_step[b] |= differ;
  };
  for (std::size_t y = 0, i = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x, ++i) {
      const bool is_last = x + 1 == width;
      if (!is_last) compare(i, i + 1);
      if (y + 1 == height) continue;
      if (x != 0) compare(i, i + width - 1);
      compare(i, i + width);
      if (!is_last) compare(i, i + width + 1);
    }
  }
}

Status SampledTiles::RenderSmooth(TileSums* sums) const {
  const Tile& tile = sums->tile;
  // The tile with its neighbours in the whole image.
  const Tile wide = {std::max(tile.x0 - 1, 0), std::max(tile.y0 - 1, 0),
                     std::min(tile.x1 + 1, image_->camera.width),
                     std::min(tile.y1 + 1, image_->camera.height)};
  std::vector<Hit> line_hits(lines_.draws_lines() ? tile.pixel_count() : 0);
  {
    const ScratchPool::Lease lease(pool_);
    TileScratch* const scratch = lease.get();
    if (Status status = TraceCentres(wide, scratch); !status.ok()) return status;
    FindSteps(wide, scratch);
    std::size_t next = 0;
    ForEachInPixelOrder(wide.width(), wide.height(), [&](int column, int row) {
      const std::size_t k = next++;
      const int x = wide.x0 + column - tile.x0;
      const int y = wide.y0 + row - tile.y0;
      if (x < 0 || y < 0 || x >= tile.width() || y >= tile.height()) return;
      const auto i = static_cast<std::size_t>(y * tile.width() + x);
      if (!line_hits.empty()) line_hits[i] = scratch->hits[k];
      if (scratch->is_step[static_cast<std::size_t>(row * wide.width() + column)] != 0) return;
      PixelSums& pixel = sums->pixels[i];
      pixel.samples = 1;
      pixel.misses = scratch->hits[k].IsHit() ? 0 : 1;
      pixel.sum = Vec3d(scratch->values[k]);
      pixel.stopped = true;
    });
  }
  if (lines_.draws_lines()) {
    if (Status status = DrawLines(1, line_hits, sums); !status.ok()) return status;
  }
  return Refine(kSmoothSamples, sums);
}

void SampledTiles::Write(const TileSums& sums) const {
  std::size_t i = 0;
  for (int y = sums.tile.y0; y < sums.tile.y1; ++y) {
    for (int x = sums.tile.x0; x < sums.tile.x1; ++x, ++i) {
      WritePixel(sums.pixels[i], x, y);
      if (!sums.line_opacity.empty()) lines_.DrawLine(sums.line_opacity[i], x, y);
    }
  }
}

void SampledTiles::WritePixel(const PixelSums& pixel, int x, int y) const {
  if (mode_ == RenderMode::kShaded) {
    WriteShaded(pixel, x, y);
  } else if (mode_ == RenderMode::kNormal) {
    WriteNormal(pixel, x, y);
  } else {
    WriteOcclusion(pixel, x, y);
  }
}

void SampledTiles::WriteShaded(const PixelSums& pixel, int x, int y) const {
  const Vec3d mean = pixel.sum * (1.0 / pixel.samples);
  const double missed = static_cast<double>(pixel.misses) / pixel.samples;
  const auto over = [&](double light, float behind) {
    return ToFloat(light + static_cast<double>(behind) * missed);
  };
  const FourFloats light = {over(mean.x, background_.r), over(mean.y, background_.g),
                            over(mean.z, background_.b),
                            background_.a == 1.0f ? 1.0f : pixel.Coverage()};
  StoreLight(light, x, y);
}

void SampledTiles::StoreLight(const FourFloats& light, int x, int y) const {
  if (!image_->codes) {
    __builtin_memcpy(std::get<Film<float>>(image_->values)(x, y).data(), &light, sizeof(light));
    return;
  }
  float channels[4];
  __builtin_memcpy(channels, &light, sizeof(light));
  const std::span<std::uint8_t> pixel = (*image_->codes)(x, y);
  if (pixel.size() == 3) {
    EncodeLight<3>(codes_, channels, pixel.data());
  } else {
    EncodeLight<4>(codes_, channels, pixel.data());
  }
}

void SampledTiles::WriteNormal(const PixelSums& pixel, int x, int y) const {
  const Vec3f mean(pixel.sum * (1.0 / pixel.samples));
  const std::span<float> values = std::get<Film<float>>(image_->values)(x, y);
  for (int k = 0; k < 3; ++k) values[static_cast<std::size_t>(k)] = mean[k] + 0.0f;  // no -0
  (*image_->coverage)(x, y)[0] = pixel.Coverage();
}

// Nothing hides the surroundings of a miss.
void SampledTiles::WriteOcclusion(const PixelSums& pixel, int x, int y) const {
  std::get<Film<float>>(image_->values)(x, y)[0] =
      static_cast<float>((pixel.sum.x + pixel.misses) / pixel.samples);
  (*image_->coverage)(x, y)[0] = pixel.Coverage();
}

}  // namespace kdray::core
