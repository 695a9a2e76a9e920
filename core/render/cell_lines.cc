// SPDX-License-Identifier: Apache-2.0
#include "core/render/cell_lines.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace kdray::core {
namespace {

constexpr double kHiddenBySizePx = 2;
// Work (CancelPoll) of creating a segment, of adding it to a bin, and of drawing a row of its
// pixels.
constexpr std::uint64_t kSegmentWork = 256;
constexpr std::uint64_t kBinWork = 16;
constexpr std::uint64_t kRowWork = 256;
constexpr double kFullWidthHeight = 640;  // image height from which lines grow with the image

// Clips the parameter interval [*enter, *exit] of a segment to where a value that changes linearly
// from `at_start` to `at_end` is >= 0. False when the result is empty. Source: Liang and Barsky
// 1984.
bool ClipToPositive(double at_start, double at_end, double* enter, double* exit) {
  if (at_start < 0 && at_end < 0) return false;
  if (at_start < 0) *enter = std::max(*enter, at_start / (at_start - at_end));
  if (at_end < 0) *exit = std::min(*exit, at_start / (at_start - at_end));
  return *enter <= *exit;
}

}  // namespace

CellLines::CellLines(std::span<const TreeCell> cells, const Camera& camera, const Region& region,
                     const LineStyle& style, const CancelToken& cancel)
    : camera_(camera), region_(region), style_(style) {
  const double scale = std::max(1.0, camera.height / kFullWidthHeight);
  half_width_px_ = static_cast<double>(style.width_px) * scale / 2;
  reach_px_ = half_width_px_ + 0.5;

  near_depth_ = std::numeric_limits<double>::infinity();
  far_depth_ = 0;
  CancelPoll poll(cancel);
  for (const TreeCell& cell : cells) {
    if (poll.Spend(kSegmentWork)) return;
    for (unsigned i = 0; i < 8; ++i) {
      const double depth = std::max(camera.ToView(cell.bounds.Corner(i)).depth, 0.0);
      near_depth_ = std::min(near_depth_, depth);
      far_depth_ = std::max(far_depth_, depth);
    }
  }
  for (const TreeCell& cell : cells) {
    if (poll.Spend(12 * kSegmentWork)) return;
    const float opacity = cell.triangles == 0 ? style.empty_opacity : 1.0f;
    for (unsigned i = 0; i < 8; ++i) {
      for (unsigned axis = 1; axis < 8; axis <<= 1) {
        if ((i & axis) == 0) {
          AddEdge(cell.bounds.Corner(i), cell.bounds.Corner(i | axis), opacity);
        }
      }
    }
  }
  FillBins(&poll);
}

void CellLines::AddEdge(const Vec3d& from, const Vec3d& to, float opacity) {
  const bool perspective = camera_.projection == Projection::kPerspective;
  const Camera::ViewPoint a = camera_.ToView(from);
  const Camera::ViewPoint b = camera_.ToView(to);
  // Clips to the image and a margin for the width of lines, before the division by depth: points
  // behind the eye have no image position.
  const double margin = reach_px_ + 1;
  const double left = -(camera_.center_x_px + margin) * camera_.pixel_width;
  const double right = (camera_.width - camera_.center_x_px + margin) * camera_.pixel_width;
  const double bottom = (camera_.center_y_px - camera_.height - margin) * camera_.pixel_height;
  const double top = (camera_.center_y_px + margin) * camera_.pixel_height;
  const double at_a = perspective ? a.depth : 1.0;
  const double at_b = perspective ? b.depth : 1.0;
  double enter = 0;
  double exit = 1;
  if (!ClipToPositive(a.depth, b.depth, &enter, &exit) ||
      !ClipToPositive(right * at_a - a.x, right * at_b - b.x, &enter, &exit) ||
      !ClipToPositive(a.x - left * at_a, b.x - left * at_b, &enter, &exit) ||
      !ClipToPositive(top * at_a - a.y, top * at_b - b.y, &enter, &exit) ||
      !ClipToPositive(a.y - bottom * at_a, b.y - bottom * at_b, &enter, &exit)) {
    return;
  }
  const auto at = [&](double s) {
    return Camera::ViewPoint{a.x + s * (b.x - a.x), a.y + s * (b.y - a.y),
                             a.depth + s * (b.depth - a.depth)};
  };
  const Camera::ViewPoint start = at(enter);
  const Camera::ViewPoint end = at(exit);
  // Only a line through the eye can still have a depth of 0.
  if (perspective && !(start.depth > 0 && end.depth > 0)) return;
  const Camera::ImagePoint p = camera_.ToImage(start);
  const Camera::ImagePoint q = camera_.ToImage(end);
  if (!std::isfinite(p.x_px + p.y_px + q.x_px + q.y_px)) return;
  segments_.push_back({p.x_px, p.y_px, q.x_px, q.y_px, perspective ? 1 / start.depth : start.depth,
                       perspective ? 1 / end.depth : end.depth, opacity});
}

// Calls visit(bin) for every bin that may contain pixels within reach of the segment.
template <class Visit>
void CellLines::VisitBins(const Segment& s, const Visit& visit) const {
  const double side = bins_.side;
  const auto bin_of = [&](double px, int origin, int count) {
    return static_cast<int>(std::clamp(std::floor((px - origin) / side), 0.0, count - 1.0));
  };
  const double reach = reach_px_ + 1;
  const double top = std::min(s.y0, s.y1) - reach;
  const double bottom = std::max(s.y0, s.y1) + reach;
  if (bottom < region_.y0 || top > region_.y1) return;
  const int last_row = bin_of(bottom, region_.y0, bins_.rows);
  for (int row = bin_of(top, region_.y0, bins_.rows); row <= last_row; ++row) {
    // The part of the segment that passes this row of bins.
    double enter = 0;
    double exit = 1;
    const double row_top = region_.y0 + row * side - reach;
    const double row_bottom = region_.y0 + (row + 1) * side + reach;
    if (!ClipToPositive(s.y0 - row_top, s.y1 - row_top, &enter, &exit) ||
        !ClipToPositive(row_bottom - s.y0, row_bottom - s.y1, &enter, &exit)) {
      continue;
    }
    const double xa = s.x0 + enter * (s.x1 - s.x0);
    const double xb = s.x0 + exit * (s.x1 - s.x0);
    const double left = std::min(xa, xb) - reach;
    const double right = std::max(xa, xb) + reach;
    if (right < region_.x0 || left > region_.x1) continue;
    const int last_column = bin_of(right, region_.x0, bins_.columns);
    for (int column = bin_of(left, region_.x0, bins_.columns); column <= last_column; ++column) {
      visit(static_cast<std::size_t>(row) * static_cast<std::size_t>(bins_.columns) +
            static_cast<std::size_t>(column));
    }
  }
}

void CellLines::FillBins(CancelPoll* poll) {
  // At most 128 bins across, few compared with the pixels.
  bins_.side = std::max(32, (std::max(region_.width(), region_.height()) + 127) / 128);
  bins_.columns = (region_.width() + bins_.side - 1) / bins_.side;
  bins_.rows = (region_.height() + bins_.side - 1) / bins_.side;
  bins_.first.assign(
      static_cast<std::size_t>(bins_.columns) * static_cast<std::size_t>(bins_.rows) + 1, 0);
  for (const Segment& segment : segments_) {
    if (poll->Spend(kSegmentWork)) return;
    VisitBins(segment, [&](std::size_t bin) {
      poll->Spend(kBinWork);
      ++bins_.first[bin + 1];
    });
  }
  for (std::size_t i = 1; i < bins_.first.size(); ++i) bins_.first[i] += bins_.first[i - 1];
  bins_.segments.resize(bins_.first.back());
  std::vector<std::uint32_t> next = bins_.first;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    if (poll->Spend(kSegmentWork)) return;
    VisitBins(segments_[i], [&](std::size_t bin) {
      poll->Spend(kBinWork);
      bins_.segments[next[bin]++] = static_cast<std::uint32_t>(i);
    });
  }
}

Status CellLines::Draw(const Tile& tile, std::span<const Hit> hits, int samples,
                       std::span<float> opacity, const CancelToken& cancel) const {
  CancelPoll poll(cancel);
  if (poll.Spend(kRowWork)) return poll.ToError();
  std::fill(opacity.begin(), opacity.end(), 0.0f);
  const int last_row = (tile.y1 - 1 - region_.y0) / bins_.side;
  const int last_column = (tile.x1 - 1 - region_.x0) / bins_.side;
  for (int row = (tile.y0 - region_.y0) / bins_.side; row <= last_row; ++row) {
    for (int column = (tile.x0 - region_.x0) / bins_.side; column <= last_column; ++column) {
      const std::size_t bin =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(bins_.columns) +
          static_cast<std::size_t>(column);
      const Tile part = {std::max(tile.x0, region_.x0 + column * bins_.side),
                         std::max(tile.y0, region_.y0 + row * bins_.side),
                         std::min(tile.x1, region_.x0 + (column + 1) * bins_.side),
                         std::min(tile.y1, region_.y0 + (row + 1) * bins_.side)};
      for (std::uint32_t i = bins_.first[bin]; i < bins_.first[bin + 1]; ++i) {
        if (poll.Spend(kRowWork)) return poll.ToError();
        DrawSegment(segments_[bins_.segments[i]], part, tile, hits, samples, opacity, &poll);
      }
    }
  }
  return poll.ToStatus();
}

void CellLines::DrawSegment(const Segment& s, const Tile& part, const Tile& tile,
                            std::span<const Hit> hits, int samples, std::span<float> opacity,
                            CancelPoll* poll) const {
  const double dx = s.x1 - s.x0;
  const double dy = s.y1 - s.y0;
  const double length2 = dx * dx + dy * dy;
  const auto clamp_px = [](double px, int low, int high) {
    return static_cast<int>(std::clamp(px, static_cast<double>(low), static_cast<double>(high)));
  };
  const int y_end = clamp_px(std::ceil(std::max(s.y0, s.y1) + reach_px_), part.y0, part.y1);
  for (int y = clamp_px(std::floor(std::min(s.y0, s.y1) - reach_px_), part.y0, part.y1); y < y_end;
       ++y) {
    if (poll->Spend(kRowWork)) return;
    // The part of the segment near this row of pixels.
    double enter = 0;
    double exit = 1;
    if (!ClipToPositive(s.y0 - (y - reach_px_), s.y1 - (y - reach_px_), &enter, &exit) ||
        !ClipToPositive(y + 1 + reach_px_ - s.y0, y + 1 + reach_px_ - s.y1, &enter, &exit)) {
      continue;
    }
    const double xa = s.x0 + enter * dx;
    const double xb = s.x0 + exit * dx;
    const int x_end = clamp_px(std::ceil(std::max(xa, xb) + reach_px_), part.x0, part.x1);
    for (int x = clamp_px(std::floor(std::min(xa, xb) - reach_px_), part.x0, part.x1); x < x_end;
         ++x) {
      // How much of the pixel the line covers, from the distance of their centres.
      const double px = x + 0.5 - s.x0;
      const double py = y + 0.5 - s.y0;
      const double along = length2 > 0 ? std::clamp((px * dx + py * dy) / length2, 0.0, 1.0) : 0.0;
      const double distance = std::hypot(px - along * dx, py - along * dy);
      const double coverage =
          std::clamp(half_width_px_ + 0.5 - distance, 0.0, std::min(1.0, 2 * half_width_px_));
      if (coverage == 0) continue;
      const double w = s.w0 + along * (s.w1 - s.w0);
      const double depth = camera_.projection == Projection::kPerspective ? 1 / w : w;
      const float strongest = static_cast<float>(coverage) * s.opacity * FadeAt(depth);
      const std::size_t pixel =
          static_cast<std::size_t>(y - tile.y0) * static_cast<std::size_t>(tile.width()) +
          static_cast<std::size_t>(x - tile.x0);
      if (strongest <= opacity[pixel]) continue;  // another line wins, hidden or not

      const double hiding_depth = depth - kHiddenBySizePx * camera_.PixelSize(depth);
      poll->Spend(static_cast<std::uint64_t>(samples));
      int seen = 0;
      const std::size_t first = pixel * static_cast<std::size_t>(samples);
      for (std::size_t i = 0; i < static_cast<std::size_t>(samples); ++i) {
        seen += hits[first + i].t >= hiding_depth ? 1 : 0;
      }
      const float share = static_cast<float>(seen) / static_cast<float>(samples);
      opacity[pixel] = std::max(opacity[pixel], strongest * share);
    }
  }
}

float CellLines::FadeAt(double depth) const {
  const double range = far_depth_ - near_depth_;
  const double share = range > 0 ? std::clamp((depth - near_depth_) / range, 0.0, 1.0) : 0.0;
  return style_.near_opacity +
         (style_.far_opacity - style_.near_opacity) * static_cast<float>(share);
}

}  // namespace kdray::core
