// SPDX-License-Identifier: Apache-2.0
// A generated interior for the benchmarks: rooms with huge, tiny, and long thin triangles.
#pragma once

#include "core/geometry/triangle_mesh.h"

namespace kdray::bench {

/// One floor of an office, 40 x 3.2 x 24 with y up: slabs and walls of a few triangles each,
/// columns and pipes as long thin triangles, window blinds, and in each of ten rooms six desks,
/// turned by any angle, with chairs, screens, keyboards and round lamps. Some 290,000 triangles.
/// The same on every machine except for the last bits of sin and cos.
core::MeshData OfficeFloor();

}  // namespace kdray::bench
