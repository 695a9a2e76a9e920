// SPDX-License-Identifier: Apache-2.0
// The samples that are formulas. The teapot, which is a table, has its own file.
#pragma once

#include "clients/cpp/sample/sample_mesh.h"

namespace kdray::client {

/// Unit sphere: every face of an icosahedron cut into detail^2 triangles and pushed out to
/// radius 1.
SampleMesh MakeSphere(const SampleOptions& options);

/// The cube [-1, 1]^3, each side a grid of detail x detail squares.
SampleMesh MakeCube(const SampleOptions& options);

/// A ring of radius 1 around the y axis with a tube of radius 0.4: 2 detail steps around the axis,
/// detail around the tube.
SampleMesh MakeTorus(const SampleOptions& options);

/// A height field over [-1, 1] x [-1, 1] in x and z, detail squares along each side: value noise in
/// six octaves, the same for the same seed on every machine.
SampleMesh MakeTerrain(const SampleOptions& options);

}  // namespace kdray::client
