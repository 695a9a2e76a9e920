// SPDX-License-Identifier: Apache-2.0
// The rays of a scanner with beams at given elevations, and the points that a scan leaves.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "clients/cpp/command/camera.h"
#include "kdray/batches.h"

namespace kdray::client {

/// A scanner that turns around `up`. Angles as the contract's `spherical`: azimuth a = ((i + .5) /
/// steps - .5) * h_fov, direction = cos e (cos a * f + sin a * r) + sin e * up, where f is
/// `forward` without its component along `up`, and r = f x up.
struct Scanner {
  Vector3 eye = {};
  Vector3 forward = {0, 0, -1};
  Vector3 up = {0, 1, 0};
  double h_fov_deg = 360;
  std::uint64_t steps = 1024;          ///< columns
  std::vector<double> elevations_deg;  ///< of the beams, one row each

  /// The beams' rays, row by row: the beam's, then the column's order. Throws UsageError if
  /// `forward` is along `up`.
  std::vector<Ray> Rays() const;
};

/// "-15,-13,0.5" as numbers within -90..90. Throws UsageError for anything else.
std::vector<double> ParseElevations(const std::string& text);

/// Appends the rows of three doubles (little-endian) that are finite to `points`.
void AppendFinite(std::string_view rows, std::string& points);

/// A binary little-endian PLY point cloud of such rows: `property double x, y, z`.
std::string PlyPointCloudHeader(std::uint64_t points);

}  // namespace kdray::client
