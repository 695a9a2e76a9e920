// SPDX-License-Identifier: Apache-2.0
// Sample meshes from formulas, so no file must be fetched for a first picture. The y axis points
// up, as in the service's default camera; closed shapes face outwards.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

namespace kdray::client {

using Point = std::array<double, 3>;
using Face = std::array<std::uint32_t, 3>;

/// Triangles over shared vertices, counter-clockwise seen from outside.
struct SampleMesh {
  std::vector<Point> vertices;
  std::vector<Face> triangles;
};

/// The resolution of a sample. `detail` is the number of pieces along one edge of the shape's grid.
struct SampleOptions {
  int detail = 0;          ///< 1..kMaxSampleDetail; 0 is the shape's default
  std::uint32_t seed = 1;  ///< of the terrain; the other shapes ignore it
};

inline constexpr int kMaxSampleDetail = 2048;

/// One row for each shape of `kdray sample NAME`.
struct SampleShape {
  std::string_view name;
  std::string_view description;
  int default_detail;
  SampleMesh (*make)(const SampleOptions& options);  ///< options.detail must not be 0
};

/// All shapes, in the order of the help.
const std::vector<SampleShape>& SampleShapes();

/// The shape of that name, or nullptr.
const SampleShape* FindSampleShape(std::string_view name);

/// @pre options.detail is 0 or in [1, kMaxSampleDetail].
SampleMesh MakeSample(const SampleShape& shape, SampleOptions options);

}  // namespace kdray::client
