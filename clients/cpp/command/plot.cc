// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/plot.h"

#include <cairo.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "clients/cpp/command/text.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

constexpr double kPanelWidth = 640, kHeight = 560;
constexpr double kLeftMargin = 92, kRightMargin = 20, kTopMargin = 84, kBottomMargin = 116;
constexpr double kSmall = 12, kNormal = 14, kLarge = 17;
constexpr double kMarkerRadius = 5.5;

struct Color {
  double r, g, b;
};

// Colours that colour-blind readers tell apart.
// Source: Okabe and Ito, "Color Universal Design", 2008.
constexpr std::array<Color, 8> kColors = {{{0.84, 0.37, 0.00},
                                           {0.00, 0.45, 0.70},
                                           {0.00, 0.62, 0.45},
                                           {0.80, 0.47, 0.65},
                                           {0.90, 0.62, 0.00},
                                           {0.34, 0.71, 0.91},
                                           {0.60, 0.60, 0.00},
                                           {0.00, 0.00, 0.00}}};

bool IsDrawn(const PlotPoint& point) {
  return std::isfinite(point.x) && std::isfinite(point.y) && point.x > 0 && point.y > 0;
}

// A logarithmic axis; positions are 0 at its lower end and 1 at its upper.
class Axis {
 public:
  Axis(double low, double high) {
    // Room on both sides, and at least a factor of two between the ends.
    const double middle = std::sqrt(low) * std::sqrt(high);
    low_ = std::log10(std::min(low / 1.25, middle / std::numbers::sqrt2));
    high_ = std::log10(std::max(high * 1.25, middle * std::numbers::sqrt2));
  }

  double At(double value) const { return (std::log10(value) - low_) / (high_ - low_); }

  /// Powers of ten, with their multiples by 2 and 5 where there is room.
  std::vector<double> Ticks() const {
    const double decades = high_ - low_;
    const int step = std::max(1, static_cast<int>(std::ceil(decades / 8)));
    std::vector<double> ticks;
    for (int power = static_cast<int>(std::floor(low_)); power <= std::ceil(high_); ++power) {
      for (const double factor : {1.0, 2.0, 5.0}) {
        if (factor > 1 && decades > 2.5) continue;
        if (factor == 1 && power % step != 0) continue;
        const double position = (power + std::log10(factor) - low_) / decades;
        if (position >= 0 && position <= 1) ticks.push_back(factor * std::pow(10, power));
      }
    }
    return ticks;
  }

 private:
  double low_, high_;
};

Axis AxisOf(const std::vector<PlotPoint>& points, double PlotPoint::*coordinate) {
  double low = 1, high = 1;
  bool any = false;
  for (const PlotPoint& point : points) {
    if (!IsDrawn(point)) continue;
    low = any ? std::min(low, point.*coordinate) : point.*coordinate;
    high = any ? std::max(high, point.*coordinate) : point.*coordinate;
    any = true;
  }
  return {low, high};
}

std::string TickText(double value) {
  const double power = std::log10(value);
  if (value >= 0.001 && value < 1e4) return NumberText(value, 3);
  // "1e-07" as people write it.
  const int whole = static_cast<int>(std::floor(power + 1e-9));
  const double factor = value / std::pow(10, whole);
  return (factor > 1.5 ? NumberText(factor, 2) + "e" : "1e") + std::to_string(whole);
}

class Canvas {
 public:
  explicit Canvas(double width)
      : surface_(cairo_image_surface_create(CAIRO_FORMAT_RGB24, static_cast<int>(width),
                                            static_cast<int>(kHeight)),
                 &cairo_surface_destroy),
        cairo_(cairo_create(surface_.get()), &cairo_destroy) {
    cairo_select_font_face(cairo(), "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                           CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_source_rgb(cairo(), 1, 1, 1);
    cairo_paint(cairo());
  }

  enum class Align { kLeft, kCenter, kRight };

  void SetColor(const Color& color) { cairo_set_source_rgb(cairo(), color.r, color.g, color.b); }

  double WidthOf(const std::string& text, double size) {
    cairo_set_font_size(cairo(), size);
    cairo_text_extents_t extents;
    cairo_text_extents(cairo(), text.c_str(), &extents);
    return extents.x_advance;
  }

  void Text(double x, double y, const std::string& text, double size, Align align,
            double angle = 0) {
    const double width = WidthOf(text, size);
    const double shift = align == Align::kLeft ? 0 : align == Align::kCenter ? width / 2 : width;
    cairo_save(cairo());
    cairo_translate(cairo(), x, y);
    cairo_rotate(cairo(), angle);
    cairo_move_to(cairo(), -shift, 0);
    cairo_show_text(cairo(), text.c_str());
    cairo_restore(cairo());
  }

  void Line(double x0, double y0, double x1, double y1, double width) {
    cairo_set_line_width(cairo(), width);
    cairo_move_to(cairo(), x0, y0);
    cairo_line_to(cairo(), x1, y1);
    cairo_stroke(cairo());
  }

  // Circle, square, triangle, diamond, inverted triangle, cross and so on.
  void Marker(double x, double y, std::size_t kind, bool hollow) {
    const double r = kMarkerRadius;
    const auto polygon = [&](int corners, double first_angle) {
      for (int i = 0; i < corners; ++i) {
        const double a = first_angle + 2 * std::numbers::pi * i / corners;
        cairo_line_to(cairo(), x + 1.15 * r * std::cos(a), y + 1.15 * r * std::sin(a));
      }
      cairo_close_path(cairo());
    };
    constexpr double kQuarter = std::numbers::pi / 2;
    cairo_new_path(cairo());
    switch (kind) {
      case 0:
        cairo_arc(cairo(), x, y, r, 0, 2 * std::numbers::pi);
        break;
      case 1:
        polygon(4, kQuarter / 2);
        break;
      case 2:
        polygon(3, -kQuarter);
        break;
      case 3:
        polygon(4, 0);
        break;
      case 4:
        polygon(3, kQuarter);
        break;
      default:
        polygon(static_cast<int>(kind), -kQuarter);
    }
    cairo_set_line_width(cairo(), 1.6);
    hollow ? cairo_stroke(cairo()) : cairo_fill(cairo());
  }

  std::string Png() {
    std::string bytes;
    const auto append = [](void* closure, const unsigned char* data, unsigned length) {
      static_cast<std::string*>(closure)->append(reinterpret_cast<const char*>(data), length);
      return CAIRO_STATUS_SUCCESS;
    };
    cairo_status_t status = cairo_status(cairo());
    if (status == CAIRO_STATUS_SUCCESS) {
      status = cairo_surface_write_to_png_stream(surface_.get(), append, &bytes);
    }
    if (status != CAIRO_STATUS_SUCCESS) {
      throw LocalFileError(std::string("the plot cannot be drawn: ") +
                           cairo_status_to_string(status));
    }
    return bytes;
  }

 private:
  cairo_t* cairo() { return cairo_.get(); }

  std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)> surface_;
  std::unique_ptr<cairo_t, decltype(&cairo_destroy)> cairo_;
};

constexpr Color kInk = {0.13, 0.13, 0.13};
constexpr Color kGrid = {0.88, 0.88, 0.88};

void DrawPanel(Canvas& canvas, const PlotPanel& panel, double left) {
  const double x0 = left + kLeftMargin, x1 = left + kPanelWidth - kRightMargin;
  const double y0 = kHeight - kBottomMargin, y1 = kTopMargin;
  const Axis x_axis = AxisOf(panel.points, &PlotPoint::x);
  const Axis y_axis = AxisOf(panel.points, &PlotPoint::y);
  const auto to_x = [&](double value) { return x0 + (x1 - x0) * x_axis.At(value); };
  const auto to_y = [&](double value) { return y0 + (y1 - y0) * y_axis.At(value); };

  for (const double tick : x_axis.Ticks()) {
    canvas.SetColor(kGrid);
    canvas.Line(to_x(tick), y0, to_x(tick), y1, 1);
    canvas.SetColor(kInk);
    canvas.Text(to_x(tick), y0 + 18, TickText(tick), kSmall, Canvas::Align::kCenter);
  }
  for (const double tick : y_axis.Ticks()) {
    canvas.SetColor(kGrid);
    canvas.Line(x0, to_y(tick), x1, to_y(tick), 1);
    canvas.SetColor(kInk);
    canvas.Text(x0 - 8, to_y(tick) + 4, TickText(tick), kSmall, Canvas::Align::kRight);
  }
  canvas.SetColor(kInk);
  canvas.Line(x0, y0, x1, y0, 1);
  canvas.Line(x0, y0, x0, y1, 1);
  canvas.Text((x0 + x1) / 2, y1 - 10, panel.title, kNormal, Canvas::Align::kCenter);
  canvas.Text((x0 + x1) / 2, y0 + 40, panel.x_label, kNormal, Canvas::Align::kCenter);
  canvas.Text(left + 22, (y0 + y1) / 2, panel.y_label, kNormal, Canvas::Align::kCenter,
              -std::numbers::pi / 2);
  for (const PlotPoint& point : panel.points) {
    if (!IsDrawn(point)) continue;
    const double x = to_x(point.x), y = to_y(point.y);
    canvas.SetColor(kColors[point.color % kColors.size()]);
    canvas.Marker(x, y, point.marker, point.is_bound);
    if (point.is_bound) {
      canvas.Line(x, y + kMarkerRadius, x, y + 2.6 * kMarkerRadius, 1.2);
      canvas.Line(x - 3, y + 2 * kMarkerRadius, x, y + 2.6 * kMarkerRadius, 1.2);
      canvas.Line(x + 3, y + 2 * kMarkerRadius, x, y + 2.6 * kMarkerRadius, 1.2);
    }
  }
}

void DrawLegend(Canvas& canvas, const Plot& plot) {
  constexpr double kGap = 22;
  const auto row = [&](double y, const std::vector<std::string>& names, bool by_color) {
    double x = kLeftMargin;
    for (std::size_t i = 0; i < names.size(); ++i) {
      canvas.SetColor(by_color ? kColors[i % kColors.size()] : kInk);
      canvas.Marker(x, y - 4, by_color ? 0 : i, false);
      canvas.SetColor(kInk);
      canvas.Text(x + 11, y, names[i], kSmall, Canvas::Align::kLeft);
      x += 11 + canvas.WidthOf(names[i], kSmall) + kGap;
    }
  };
  row(kHeight - 42, plot.colors, true);
  row(kHeight - 18, plot.markers, false);
}

}  // namespace

std::string DrawPng(const Plot& plot) {
  Canvas canvas(kPanelWidth * static_cast<double>(std::max<std::size_t>(plot.panels.size(), 1)));
  canvas.SetColor(kInk);
  canvas.Text(kLeftMargin, 28, plot.title, kLarge, Canvas::Align::kLeft);
  canvas.Text(kLeftMargin, 50, plot.subtitle, kSmall, Canvas::Align::kLeft);
  for (std::size_t i = 0; i < plot.panels.size(); ++i) {
    DrawPanel(canvas, plot.panels[i], kPanelWidth * static_cast<double>(i));
  }
  DrawLegend(canvas, plot);
  return canvas.Png();
}

}  // namespace kdray::client
