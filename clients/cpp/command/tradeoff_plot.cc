// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/tradeoff_plot.h"

#include <algorithm>

#include "clients/cpp/command/tradeoff_text.h"

namespace kdray::client {
namespace {

constexpr double kHalfUlp = 0x1p-53;

std::size_t IndexOf(std::vector<std::string>& names, const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  names.push_back(name);
  return names.size() - 1;
}

}  // namespace

Plot PlotOf(const Document& tradeoff) {
  Plot plot;
  plot.title = "Speed and accuracy on one mesh";
  plot.subtitle = TradeoffConditions(tradeoff);
  PlotPanel leaks = {.title = "Leaks (hollow: none seen, at most this)",
                     .x_label = "aimed rays a second, in millions",
                     .y_label = "share of rays that leak",
                     .points = {}};
  PlotPanel errors = {.title = "Errors of t (hollow: none seen, at most this)",
                      .x_label = leaks.x_label,
                      .y_label = "relative error of t, 99.9th percentile",
                      .points = {}};
  for (const Document& row : tradeoff["results"].Items()) {
    PlotPoint point;
    point.color = IndexOf(plot.colors, row["precision"].Text().value_or("?"));
    point.marker = IndexOf(plot.markers, row["build"].Text().value_or("?"));
    point.x = row["aimed"]["rays_per_s"].Number().value_or(0) / 1e6;
    const Document rate = row["leaks"];
    const auto below = rate["below"].Number();
    point.is_bound = below.has_value();
    point.y = below.value_or(rate["rate"].Number().value_or(0));
    leaks.points.push_back(point);
    // No error that double can show is at most half a unit in the last place.
    const auto error = row["t_error"]["p999"].Number();
    point.is_bound = error == 0;
    point.y = point.is_bound ? kHalfUlp : error.value_or(0);
    errors.points.push_back(point);
  }
  plot.panels = {std::move(leaks), std::move(errors)};
  return plot;
}

}  // namespace kdray::client
