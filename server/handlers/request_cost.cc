// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/request_cost.h"

#include <algorithm>

namespace kdray::server {
namespace {

/// The smallest rows of .npy: six floats, three floats. Those of JSON are as long or longer.
constexpr std::uint64_t kRayBytes = 24, kPointBytes = 12;
/// A closest point takes as long as some rays.
constexpr std::uint64_t kRaysPerPoint = 4;
/// Listing this many hits takes as long as finding the closest one.
constexpr std::uint64_t kHitsPerRay = 8;
constexpr std::uint64_t kRaysPerMs = 1000;

std::uint64_t Pixels(const api::RenderRequest& request) {
  const auto area = [](std::int64_t width, std::int64_t height) {
    return static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  };
  if (!request.region) return area(request.width, request.height);
  return area(request.region->x1 - request.region->x0, request.region->y1 - request.region->y0);
}

/// Rays of a pixel's sample: the camera's, and those that shading sends.
std::uint64_t RaysPerSample(const api::RenderRequest& request) {
  if (request.mode == api::RenderMode::kAmbientOcclusion) return 2;
  if (request.mode != api::RenderMode::kShaded || !request.shadows) return 1;
  return 1 + (request.lights ? request.lights->size() : 1);
}

/// Bytes of the renderer's values.
std::uint64_t FilmBytes(api::RenderMode mode) {
  switch (mode) {
    case api::RenderMode::kShaded:
      return 16;
    case api::RenderMode::kNormal:
      return 12 + 4;  // and what part of the pixel the mesh covers
    case api::RenderMode::kAmbientOcclusion:
      return 4 + 4;
    case api::RenderMode::kDepth:
    case api::RenderMode::kTriangle:
      return 4;
    case api::RenderMode::kCost:
      return 8;
    case api::RenderMode::kPosition:
      return 24;
  }
  return 24;
}

}  // namespace

WorkOfBody WorkOfRays(std::int64_t hits_per_ray) {
  const std::uint64_t weight = 1 + static_cast<std::uint64_t>(hits_per_ray) / kHitsPerRay;
  return [weight](std::uint64_t bytes) { return bytes / kRayBytes * weight; };
}

WorkOfBody WorkOfPoints() {
  return [](std::uint64_t bytes) { return bytes / kPointBytes * kRaysPerPoint; };
}

WorkOfBody WorkOfVisibility(const api::VisibilityOptions& options, std::uint64_t max_pairs) {
  return [from_count = options.from_count, max_pairs](std::uint64_t bytes) {
    const std::uint64_t points = bytes / kPointBytes;
    const std::uint64_t from =
        from_count ? std::min(static_cast<std::uint64_t>(*from_count), points) : points / 2;
    const std::uint64_t to = points - from;
    return to != 0 && from > max_pairs / to ? max_pairs : from * to;
  };
}

std::uint64_t WorkOfPicture(const api::RenderRequest& request, api::ImageForm form) {
  // Where smooth silhouettes decide, few pixels take all samples.
  constexpr std::int64_t kUsualSamples = 3;
  std::int64_t samples =
      request.samples.value_or(api::DefaultSamples(request.mode, form).value_or(kUsualSamples));
  if (request.max_noise || request.budget_ms) samples = request.max_samples;
  const std::uint64_t rays =
      Pixels(request) * static_cast<std::uint64_t>(samples) * RaysPerSample(request);
  if (!request.budget_ms) return rays;
  return std::min(rays, static_cast<std::uint64_t>(*request.budget_ms) * kRaysPerMs);
}

std::uint64_t MemoryOfBlock(std::uint64_t rows, std::int64_t hits_per_ray) {
  // Of server/ray_queries.cc: rows and hits of a block, a ray in doubles, a hit. Lists of hits grow
  // by doubling and are then joined.
  constexpr std::uint64_t kRows = 131'072, kHits = std::uint64_t{1} << 20;
  constexpr std::uint64_t kRayBytes = 64, kHitBytes = 32, kCopies = 3;
  const auto hits = static_cast<std::uint64_t>(hits_per_ray);
  if (hits == 1) return std::min(rows, kRows) * (kRayBytes + kHitBytes);
  return std::min(rows, kRows) * kRayBytes + std::min(rows * hits, kHits) * kHitBytes * kCopies;
}

std::uint64_t MemoryOfCells(const api::CellsRequest& request, std::uint64_t max_cells) {
  // In core's form, the contract's, and JSON, whose text grows by doubling.
  constexpr std::uint64_t kCellBytes = 64 + 72 + 3 * 200;
  const std::uint64_t nodes = request.depth < 40 ? std::uint64_t{1} << request.depth : max_cells;
  return std::min(nodes, max_cells) * kCellBytes;
}

std::uint64_t MemoryOfPicture(const api::RenderRequest& request, api::ImageForm form) {
  std::uint64_t rendering = FilmBytes(request.mode);
  if (request.mode != api::RenderMode::kShaded) {
    rendering += (request.cells_depth ? 4 : 0) + (request.edges ? 4 : 0);
  }
  std::uint64_t encoding = 0;
  if (form == api::ImageForm::kPng) {
    const std::uint64_t channels = request.transparent ? 4 : 3;
    encoding = channels + 2 * channels;  // the compressed strips, and the file made of them
    rendering += channels;
  }
  // Sums of the pixels, which are refined together.
  if (request.budget_ms) rendering += 64;
  return Pixels(request) * std::max(rendering, encoding);
}

}  // namespace kdray::server
