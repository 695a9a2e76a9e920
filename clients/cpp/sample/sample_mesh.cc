// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/sample/sample_mesh.h"

#include <algorithm>

#include "clients/cpp/sample/shapes.h"
#include "clients/cpp/sample/teapot.h"

namespace kdray::client {

const std::vector<SampleShape>& SampleShapes() {
  static const std::vector<SampleShape> shapes = {
      {"teapot", "the Utah teapot from its Bezier patches, each of its three parts closed", 24,
       MakeTeapot},
      {"sphere", "unit sphere, an icosahedron subdivided: 20 n^2 triangles", 32, MakeSphere},
      {"cube", "cube from -1 to 1: 12 n^2 triangles", 1, MakeCube},
      {"torus", "torus of radii 1 and 0.4: 4 n^2 triangles", 64, MakeTorus},
      {"terrain", "a rolling height field, open at its rim: 2 n^2 triangles", 256, MakeTerrain},
  };
  return shapes;
}

const SampleShape* FindSampleShape(std::string_view name) {
  const auto& shapes = SampleShapes();
  const auto found = std::find_if(shapes.begin(), shapes.end(),
                                  [&](const SampleShape& shape) { return shape.name == name; });
  return found == shapes.end() ? nullptr : &*found;
}

SampleMesh MakeSample(const SampleShape& shape, SampleOptions options) {
  if (options.detail == 0) options.detail = shape.default_detail;
  return shape.make(options);
}

}  // namespace kdray::client
