// SPDX-License-Identifier: Apache-2.0
// Which points of two sets see each other: makes the rays, block by block, and
// traces them.
#pragma once

#include "api/visibility.h"
#include "core/base/result.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::server {

/// Fills visible, invalid and offset. `trace` has the precision and the
/// cancellation. A pair is visible if both points are finite and the ray
/// between them, with the direction to - from in double, hits nothing.
/// Coincident points see each other; a pair whose direction is beyond the range
/// of double does not. With `to_directions`, an invalid or zero direction sees
/// nothing. Runs in the caller's arena. Memory: the answer, and some 10 MB.
/// Errors: kCancelled, kDeadlineExceeded; the answer is then unspecified.
core::Status AnswerVisibility(const core::Scene& scene, const api::PointSets& sets,
                              const api::VisibilityOptions& options,
                              const core::TraceOptions& trace, api::VisibilityAnswer* answer);

}  // namespace kdray::server
