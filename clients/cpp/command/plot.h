// SPDX-License-Identifier: Apache-2.0
// A figure of scatter plots with logarithmic axes, drawn into a PNG file. Only its .cc includes
// cairo.
#pragma once

#include <string>
#include <vector>

namespace kdray::client {

struct PlotPoint {
  double x = 0, y = 0;     ///< above 0
  std::size_t color = 0;   ///< index into Plot::colors
  std::size_t marker = 0;  ///< index into Plot::markers
  bool is_bound = false;   ///< the value is at most y: hollow, with an arrow down
};

struct PlotPanel {
  std::string title;
  std::string x_label;
  std::string y_label;
  std::vector<PlotPoint> points;  ///< those that are not finite or not above 0 are left out
};

struct Plot {
  std::string title;
  std::string subtitle;
  std::vector<std::string> colors;   ///< the legend's names, at most 8
  std::vector<std::string> markers;  ///< likewise
  std::vector<PlotPanel> panels;     ///< side by side
};

/// The bytes of a PNG picture, 640 by 560 pixels a panel. Throws LocalFileError if cairo fails.
std::string DrawPng(const Plot& plot);

}  // namespace kdray::client
