// SPDX-License-Identifier: Apache-2.0
#include "core/render/picture.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <optional>
#include <span>
#include <utility>

#include "core/base/cancel_poll.h"
#include "core/base/parallel.h"
#include "core/render/cell_lines.h"
#include "core/render/depth_range.h"
#include "core/render/heat_map.h"
#include "core/render/shading.h"
#include "core/render/srgb_codes.h"

namespace kdray::core {
namespace {

// Work (CancelPoll) of a byte of the picture.
constexpr std::uint64_t kWorkPerByte = 32;

// Colour of one pixel in front of the background, premultiplied: in codes / 255, because values
// that are not light are blended without encoding; for kAmbientOcclusion linear.
class DataColors {
 public:
  DataColors(const RenderedImage& image, const DepthRange& range) : image_(image), range_(range) {}

  Rgba operator()(int x, int y) const {
    switch (image_.mode) {
      case RenderMode::kNormal: {
        const float share = (*image_.coverage)(x, y)[0];
        const std::span<const float> n = std::get<Film<float>>(image_.values)(x, y);
        return {(n[0] + share) / 2, (n[1] + share) / 2, (n[2] + share) / 2, share};
      }
      case RenderMode::kDepth: {
        const float depth = std::get<Film<float>>(image_.values)(x, y)[0];
        if (!std::isfinite(depth)) return {};
        const float grey = static_cast<float>(GreyOf(range_, depth)) / 255.0f;
        return {grey, grey, grey, 1.0f};
      }
      case RenderMode::kTriangle: {
        const std::int32_t id = std::get<Film<std::int32_t>>(image_.values)(x, y)[0];
        if (id < 0) return {};
        const Rgb c = HashedColor(static_cast<PrimitiveId>(id));
        return {c.r, c.g, c.b, 1.0f};
      }
      case RenderMode::kAmbientOcclusion: {
        const float share = (*image_.coverage)(x, y)[0];
        // A miss counts as 1.
        const float grey =
            std::max(std::get<Film<float>>(image_.values)(x, y)[0] - (1.0f - share), 0.0f);
        return {grey, grey, grey, share};
      }
      case RenderMode::kCost: {
        const auto cost = std::get<Film<std::int32_t>>(image_.values)(x, y);
        if (cost[0] == 0 && cost[1] == 0) return {};
        const Rgb c = HeatColor(cost[0], cost[1]);
        return {c.r, c.g, c.b, 1.0f};
      }
      case RenderMode::kPosition:
      case RenderMode::kShaded:
        break;
    }
    return {};
  }

 private:
  const RenderedImage& image_;
  const DepthRange range_;
};

// `encode` turns one straight channel into its code.
template <class Encode>
void Write(const Rgba& c, const Encode& encode, std::span<std::uint8_t> pixel) {
  const float unpremultiply = c.a > 0.0f ? 1.0f / c.a : 0.0f;
  pixel[0] = encode(c.r * unpremultiply);
  pixel[1] = encode(c.g * unpremultiply);
  pixel[2] = encode(c.b * unpremultiply);
  if (pixel.size() == 4) pixel[3] = ToUnorm8(c.a);
}

/// A row of light, premultiplied red, green, blue and coverage. Most pixels of the background equal
/// the one before them.
template <std::size_t kChannels>
void WriteLightRow(std::span<const float> row, std::uint8_t* out) {
  const SrgbCodes& code_of = SrgbCodes::Table();
  const float* before = nullptr;
  for (const float* c = row.data(); c != row.data() + row.size();
       before = c, c += 4, out += kChannels) {
    if (before != nullptr && std::memcmp(before, c, 4 * sizeof(float)) == 0) {
      for (std::size_t k = 0; k < kChannels; ++k) out[k] = out[k - kChannels];
      continue;
    }
    EncodeLight<kChannels>(code_of, c, out);
  }
}

}  // namespace

Picture MakePicture(const RenderedImage& image) { return *MakePicture(image, CancelToken()); }

Result<Picture> MakePicture(RenderedImage&& image, const CancelToken& cancel) {
  if (!image.codes) return MakePicture(std::as_const(image), cancel);
  Picture picture;
  picture.width = image.region().width();
  picture.height = image.region().height();
  picture.channels = image.codes->channels();
  picture.pixels = std::move(*image.codes).TakeValues();
  return picture;
}

Result<Picture> MakePicture(const RenderedImage& image, const CancelToken& cancel) {
  const Region& region = image.region();
  const Background& background = image.background;
  Picture picture;
  picture.width = region.width();
  picture.height = region.height();
  picture.channels = background.transparent ? 4 : 3;
  if (image.codes) {
    const std::span<const std::uint8_t> codes = image.codes->values();
    picture.pixels.assign(codes.begin(), codes.end());
    return picture;
  }
  const auto channels = static_cast<std::size_t>(picture.channels);
  picture.pixels.resize(region.pixel_count() * channels);

  std::optional<DepthRange> range = image.depth_range;
  if (image.mode == RenderMode::kDepth && !range) {
    Result<std::optional<DepthRange>> of_film = RangeOfFilm(image, cancel);
    if (!of_film.ok()) return std::move(of_film).error();
    range = *of_film;
  }
  const DataColors data_color(image, range.value_or(DepthRange{}));
  const bool is_light = image.mode == RenderMode::kAmbientOcclusion;
  const auto as_blended = [&](const Rgb& color) {
    const Rgb c = is_light ? SrgbToLinear(color) : color;
    return Rgba{c.r, c.g, c.b, 1.0f};
  };
  const Rgba behind = background.transparent ? Rgba{} : as_blended(background.color);
  const Rgba line = as_blended(LineStyle{}.color);
  const Rgba edge = as_blended(kEdgeColor);

  const auto row_bytes = static_cast<std::size_t>(picture.width) * channels;
  const auto write_row = [&](std::size_t row) {
    const int y = region.y0 + static_cast<int>(row);
    std::span<std::uint8_t> rest = std::span(picture.pixels).subspan(row * row_bytes, row_bytes);
    if (image.mode == RenderMode::kShaded) {
      const auto row_values = static_cast<std::size_t>(picture.width) * 4;
      const std::span<const float> values =
          std::get<Film<float>>(image.values).values().subspan(row * row_values, row_values);
      return channels == 4 ? WriteLightRow<4>(values, rest.data())
                           : WriteLightRow<3>(values, rest.data());
    }
    for (int x = region.x0; x < region.x1; ++x, rest = rest.subspan(channels)) {
      const std::span<std::uint8_t> pixel = rest.first(channels);
      Rgba c = Over(data_color(x, y), behind);
      if (image.edges) {
        c = Over(edge * (*image.edges)(x, y)[0], c);
      }
      if (image.lines) {
        c = Over(line * (*image.lines)(x, y)[0], c);
      }
      if (is_light) {
        Write(c, LinearToSrgb8, pixel);
      } else {
        Write(c, ToUnorm8, pixel);
      }
    }
  };
  std::atomic<bool> stopped{false};
  ParallelFor(0, static_cast<std::size_t>(picture.height), 16,
              [&](std::size_t first, std::size_t last) {
                CancelPoll poll(cancel);
                for (std::size_t row = first; row < last && !stopped; ++row) {
                  if (poll.Spend(row_bytes * kWorkPerByte)) {
                    stopped = true;
                    return;
                  }
                  write_row(row);
                }
              });
  if (stopped) return cancel.ToError();
  return picture;
}

}  // namespace kdray::core
