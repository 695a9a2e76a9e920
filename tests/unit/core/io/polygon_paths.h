// SPDX-License-Identifier: Apache-2.0
// Paths of corners on a grid, which may touch themselves, and what their triangles have to cover.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// A corner on a grid.
struct Place {
  std::int64_t x = 0;
  std::int64_t y = 0;
  friend bool operator==(const Place&, const Place&) = default;
};
using Path = std::vector<Place>;

std::int64_t DoubleArea(Place a, Place b, Place c);
std::int64_t DoubleArea(const Path& path);

int Side(Place a, Place b, Place c);
/// Whether ab and cd cross between their ends.
bool Cross(Place a, Place b, Place c, Place d);
bool IsOn(Place p, Place a, Place b);
Place Next(const Path& path, std::size_t i);
bool CrossesItself(const Path& path);

/// How often the path goes counterclockwise around a point that lies on none of its edges.
int Winding(const Path& path, double x, double y);

/// The triangles of the path, in one of four planes.
MeshData Cut(const Path& path, int plane = 0);

std::string Text(const Path& path);

/// The oracle for a path that does not cross itself: n - 2 triangles, none turns against the path,
/// and their areas are together that of the path. With the boundary kept, that is enough.
void ExpectCoversOnce(const Path& path, int plane = 0);

/// Ears alone are enough: what is made for paths that cross themselves plays no part in it.
void ExpectEarsSuffice(Path path);

}  // namespace kdray::core
