// SPDX-License-Identifier: Apache-2.0
#include "core/render/depth_range.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <limits>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/parallel.h"
#include "core/render/centre_rays.h"
#include "core/render/centre_values.h"
#include "core/trace/trace.h"

namespace kdray::core {
namespace {

// Pixels that are looked at between two polls, and the side of a tile of rays.
constexpr std::size_t kPiece = std::size_t{1} << 14;
constexpr int kTileSide = CentreRays::kMostSide;

// Depths of hits so far; min and max do not depend on their order. Safe from many threads at once.
class SharedRange {
 public:
  void Add(float near, float far) {
    const std::lock_guard lock(mutex_);
    near_ = std::min(near_, near);
    far_ = std::max(far_, far);
  }
  std::optional<DepthRange> Get() const {
    if (near_ > far_) return std::nullopt;
    return DepthRange{static_cast<double>(near_), static_cast<double>(far_)};
  }

 private:
  std::mutex mutex_;
  float near_ = std::numeric_limits<float>::infinity();
  float far_ = -std::numeric_limits<float>::infinity();
};

template <class Depths>
void AddAll(const Depths& depths, SharedRange* range) {
  float near = std::numeric_limits<float>::infinity();
  float far = -near;
  for (const auto& value : depths) {
    const float depth = value;
    if (!std::isfinite(depth)) continue;
    near = std::min(near, depth);
    far = std::max(far, depth);
  }
  range->Add(near, far);
}

Status AddFilm(const RenderedImage& image, const CancelToken& cancel, SharedRange* range) {
  const std::span<const float> values = std::get<Film<float>>(image.values).values();
  std::atomic<bool> stopped{false};
  ParallelFor(0, (values.size() + kPiece - 1) / kPiece, 16,
              [&](std::size_t first, std::size_t last) {
                CancelPoll poll(cancel);
                for (std::size_t i = first; i < last && !stopped; ++i) {
                  if (poll.Spend(kPiece)) {
                    stopped = true;
                    return;
                  }
                  const std::size_t begin = i * kPiece;
                  AddAll(values.subspan(begin, std::min(kPiece, values.size() - begin)), range);
                }
              });
  if (stopped) return cancel.ToError();
  return {};
}

Status AddTraced(const Scene& scene, const RenderedImage& image, const Region& part,
                 const CancelToken& cancel, SharedRange* range) {
  if (part.width() <= 0 || part.height() <= 0) return {};
  const TileGrid tiles(part, kTileSide);
  std::atomic<bool> stopped{false};
  ParallelFor(0, tiles.size(), 1, [&](std::size_t first, std::size_t last) {
    std::vector<Ray> rays;
    std::vector<Hit> hits;
    for (std::size_t i = first; i < last && !stopped; ++i) {
      rays.resize(tiles[i].pixel_count());
      WriteCentreRays(image.camera, tiles[i], rays.data());
      hits.resize(rays.size());
      const Status status = TraceClosest(scene, std::span<const Ray>(rays),
                                         {.precision = image.precision, .cancel = cancel}, hits);
      if (!status.ok()) {
        stopped = true;
        return;
      }
      std::vector<float> depths(hits.size());
      std::transform(hits.begin(), hits.end(), depths.begin(), DepthValue);
      AddAll(depths, range);
    }
  });
  if (stopped) return cancel.ToError();
  return {};
}

}  // namespace

std::uint8_t GreyOf(const DepthRange& range, float depth) {
  // Scaled, so that no range overflows.
  const double near = range.near * 0x1p-10;
  const double far = range.far * 0x1p-10;
  if (near == far) return 255;
  const double d = std::clamp(static_cast<double>(depth) * 0x1p-10, near, far);
  return static_cast<std::uint8_t>(255 - std::floor(254 * (d - near) / (far - near) + 0.5));
}

Result<std::optional<DepthRange>> RangeOfFilm(const RenderedImage& image,
                                              const CancelToken& cancel) {
  SharedRange range;
  if (Status status = AddFilm(image, cancel, &range); !status.ok()) {
    return std::move(status).error();
  }
  return range.Get();
}

Result<std::optional<DepthRange>> RangeOfWholeImage(const Scene& scene, const RenderedImage& image,
                                                    const CancelToken& cancel) {
  SharedRange range;
  Status status = AddFilm(image, cancel, &range);
  const Region& r = image.region();
  const Camera& camera = image.camera;
  const std::array<Region, 4> rest = {Region{0, 0, camera.width, r.y0},
                                      {0, r.y0, r.x0, r.y1},
                                      {r.x1, r.y0, camera.width, r.y1},
                                      {0, r.y1, camera.width, camera.height}};
  for (const Region& part : rest) {
    if (!status.ok()) break;
    status = AddTraced(scene, image, part, cancel, &range);
  }
  if (!status.ok()) return std::move(status).error();
  return range.Get();
}

}  // namespace kdray::core
