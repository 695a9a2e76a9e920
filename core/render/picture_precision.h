// SPDX-License-Identifier: Apache-2.0
// The precision that `auto` means for an image.
#pragma once

#include "core/base/cancel.h"
#include "core/geometry/triangle_mesh.h"
#include "core/intersect/precision.h"
#include "core/render/camera.h"

namespace kdray::core {

/// kWatertight if rounding the local vertices to float moves no point of the mesh by more than a
/// hundredth of a pixel at the point of the mesh's bounds that is nearest to the eye; else, or if
/// the eye is within the bounds, AutoPrecision(mesh). Depends only on the mesh and on the camera of
/// the whole image, so regions have the same precision. O(vertices) where the bounds do not decide,
/// in parallel within the caller's arena. Must not be used after `cancel` has stopped.
Precision PicturePrecision(const TriangleMesh& mesh, const Camera& camera,
                           const CancelToken& cancel = {});

}  // namespace kdray::core
