// Traces batches of rays: converts the contract's rows, calls core's tracer, and converts the hits.
#pragma once

#include "api/types.h"
#include "core/base/result.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::server {

/// Fills hits, invalid rows, and normals and points if `options.fields` has them. Runs in the
/// caller's arena. Errors: kCancelled, kDeadlineExceeded; the answer is then unspecified.
core::Status AnswerClosest(const core::Scene& scene, const api::RayTable& rays,
                           const api::RayOptions& options, const core::TraceOptions& trace,
                           api::ClosestAnswer* answer);

/// As AnswerClosest.
core::Status AnswerAny(const core::Scene& scene, const api::RayTable& rays,
                       const core::TraceOptions& trace, api::AnyAnswer* answer);

}  // namespace kdray::server
