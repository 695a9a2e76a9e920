#include "core/render/tile_renderer.h"

#include <algorithm>
#include <limits>

#include "core/render/sampler.h"
#include "core/render/shading.h"

namespace kdray::core {
namespace {

// Of linear light, ITU-R BT.709.
double Luminance(double r, double g, double b) { return 0.2126 * r + 0.7152 * g + 0.0722 * b; }

void Store(std::span<float> pixel, const Rgba& c) {
  pixel[0] = c.r;
  pixel[1] = c.g;
  pixel[2] = c.b;
  pixel[3] = c.a;
}

// Calls f(x, y, i) for the tile's pixels, row by row.
template <class F>
void ForEachPixel(const Tile& tile, const F& f) {
  std::size_t i = 0;
  for (int y = tile.y0; y < tile.y1; ++y) {
    for (int x = tile.x0; x < tile.x1; ++x, ++i) f(x, y, i);
  }
}

}  // namespace

TileRenderer::TileRenderer(const Scene& scene, const RenderSpec& spec, const SamplingRule& rule,
                           const CancelToken& cancel, RenderedImage* image)
    : mesh_(*scene.mesh),
      scene_(scene),
      seed_(spec.seed),
      rule_(rule),
      trace_options_{.precision = spec.precision, .cancel = cancel},
      color_(SrgbToLinear(spec.color)),
      image_(image) {
  if (!image->background.transparent) {
    const Rgb linear = SrgbToLinear(image->background.color);
    background_ = {linear.r, linear.g, linear.b, 1.0f};
  }
  surface_luminance_ = Luminance(color_.r, color_.g, color_.b);
  background_luminance_ = Luminance(background_.r, background_.g, background_.b);
}

void TileRenderer::SetLines(CellLines lines) {
  const Rgb linear = SrgbToLinear(lines.style().color);
  line_color_ = {linear.r, linear.g, linear.b, 1.0f};
  lines_ = std::move(lines);
}

Status TileRenderer::RenderCentres(const Tile& tile) const {
  std::vector<Ray> rays;
  rays.reserve(tile.pixel_count());
  ForEachPixel(tile, [&](int x, int y, std::size_t) {
    rays.push_back(image_->camera.RayThrough(x + 0.5, y + 0.5));
  });
  std::vector<Hit> hits(rays.size());
  Status status = TraceClosest(scene_, std::span<const Ray>(rays), trace_options_, hits);
  if (!status.ok()) return status;
  if (image_->mode == RenderMode::kDepth) {
    constexpr double kLargest = std::numeric_limits<float>::max();
    auto& film = std::get<Film<float>>(image_->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t i) {
      film(x, y)[0] = hits[i].IsHit() ? static_cast<float>(std::min(hits[i].t, kLargest))
                                      : std::numeric_limits<float>::infinity();
    });
  } else {
    auto& film = std::get<Film<std::int32_t>>(image_->values);
    ForEachPixel(tile, [&](int x, int y, std::size_t i) {
      film(x, y)[0] = hits[i].IsHit() ? static_cast<std::int32_t>(hits[i].primitive_id) : -1;
    });
  }
  if (lines_) {
    std::vector<float> opacity(tile.pixel_count());
    status = lines_->Draw(tile, hits, 1, opacity, trace_options_.cancel);
    if (!status.ok()) return status;
    ForEachPixel(tile, [&](int x, int y, std::size_t i) { DrawLine(opacity[i], x, y); });
  }
  return {};
}

TileSums TileRenderer::Begin(const Tile& tile) {
  return {tile, std::vector<PixelSums>(tile.pixel_count()), {}};
}

Status TileRenderer::Refine(int target, TileSums* sums) const {
  const std::vector<Ray> rays = MakeRays(target, *sums);
  std::vector<Hit> hits(rays.size());
  Status status = TraceClosest(scene_, std::span<const Ray>(rays), trace_options_, hits);
  if (!status.ok()) return status;
  if (lines_ && sums->line_opacity.empty()) {
    // From the first samples, of which all pixels have the same number: their depths are accurate
    // enough for a line's edge.
    sums->line_opacity.resize(sums->pixels.size());
    status = lines_->Draw(sums->tile, hits, target, sums->line_opacity, trace_options_.cancel);
    if (!status.ok()) return status;
  }
  std::size_t first = 0;
  for (PixelSums& pixel : sums->pixels) {
    if (pixel.stopped) continue;
    const std::size_t count = static_cast<std::size_t>(target) - pixel.samples;
    if (image_->mode == RenderMode::kShaded) {
      AddShaded(std::span(rays).subspan(first, count), std::span(hits).subspan(first, count),
                &pixel);
    } else {
      AddNormals(std::span(hits).subspan(first, count), &pixel);
    }
    first += count;
    pixel.samples = static_cast<std::uint32_t>(target);
    pixel.stopped =
        target >= rule_.limit || (target >= kMinAdaptiveSamples && pixel.Noise() < rule_.max_noise);
  }
  return {};
}

// The missing samples of each pixel that has not stopped, pixel by pixel.
std::vector<Ray> TileRenderer::MakeRays(int target, const TileSums& sums) const {
  std::size_t count = 0;
  for (const PixelSums& pixel : sums.pixels) {
    if (!pixel.stopped) count += static_cast<std::size_t>(target) - pixel.samples;
  }
  std::vector<Ray> rays;
  rays.reserve(count);
  ForEachPixel(sums.tile, [&](int x, int y, std::size_t i) {
    const PixelSums& pixel = sums.pixels[i];
    if (pixel.stopped) return;
    if (rule_.centre) {
      rays.push_back(image_->camera.RayThrough(x + 0.5, y + 0.5));
      return;
    }
    const PixelSampler sampler(seed_, x, y);
    for (std::uint32_t n = pixel.samples; n < static_cast<std::uint32_t>(target); ++n) {
      const SamplePosition at = sampler[n];
      rays.push_back(image_->camera.RayThrough(x + at.x, y + at.y));
    }
  });
  return rays;
}

// Light and misses are summed separately, because mesh and background have different colours.
void TileRenderer::AddShaded(std::span<const Ray> rays, std::span<const Hit> hits,
                             PixelSums* pixel) const {
  for (std::size_t i = 0; i < hits.size(); ++i) {
    double luminance = background_luminance_;
    if (hits[i].IsHit()) {
      const float cosine =
          HeadlightCosine(UnitNormal(mesh_, hits[i].primitive_id), rays[i].direction);
      pixel->light += cosine;
      luminance = surface_luminance_ * static_cast<double>(cosine);
    } else {
      ++pixel->misses;
    }
    if (rule_.estimates) pixel->AddLuminance(luminance);
  }
}

void TileRenderer::AddNormals(std::span<const Hit> hits, PixelSums* pixel) const {
  for (const Hit& hit : hits) {
    double luminance = 0;
    if (hit.IsHit()) {
      const Vec3d normal = UnitNormal(mesh_, hit.primitive_id);
      pixel->normal = pixel->normal + normal;
      luminance = Luminance((normal.x + 1) / 2, (normal.y + 1) / 2, (normal.z + 1) / 2);
    } else {
      ++pixel->misses;
    }
    if (rule_.estimates) pixel->AddLuminance(luminance);
  }
}

void TileRenderer::Write(const TileSums& sums) const {
  ForEachPixel(sums.tile, [&](int x, int y, std::size_t i) {
    if (image_->mode == RenderMode::kShaded) {
      WriteShaded(sums.pixels[i], std::get<Film<float>>(image_->values)(x, y));
    } else {
      WriteNormal(sums.pixels[i], x, y);
    }
    if (!sums.line_opacity.empty()) DrawLine(sums.line_opacity[i], x, y);
  });
}

void TileRenderer::WriteShaded(const PixelSums& pixel, std::span<float> values) const {
  const float per_sample = 1.0f / static_cast<float>(pixel.samples);
  const float lit = pixel.light * per_sample;
  const float missed = static_cast<float>(pixel.misses) * per_sample;
  const Rgba surface = {color_.r * lit, color_.g * lit, color_.b * lit, 1.0f - missed};
  const Rgba behind = background_ * missed;
  Store(values, {surface.r + behind.r, surface.g + behind.g, surface.b + behind.b,
                 background_.a == 1.0f ? 1.0f : surface.a});
}

void TileRenderer::WriteNormal(const PixelSums& pixel, int x, int y) const {
  const Vec3f mean(pixel.normal * (1.0 / pixel.samples));
  const std::span<float> values = std::get<Film<float>>(image_->values)(x, y);
  for (int k = 0; k < 3; ++k) values[static_cast<std::size_t>(k)] = mean[k] + 0.0f;  // no -0
  (*image_->coverage)(x, y)[0] =
      static_cast<float>(pixel.samples - pixel.misses) / static_cast<float>(pixel.samples);
}

void TileRenderer::DrawLine(float opacity, int x, int y) const {
  if (image_->lines) {
    (*image_->lines)(x, y)[0] = opacity;
  } else if (opacity > 0.0f) {
    const std::span<float> under = std::get<Film<float>>(image_->values)(x, y);
    Store(under, Over(line_color_ * opacity, {under[0], under[1], under[2], under[3]}));
  }
}

}  // namespace kdray::core
