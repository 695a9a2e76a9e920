// SPDX-License-Identifier: Apache-2.0
// Answers batches of points: converts the contract's rows, calls core's point queries, and converts
// the answers, block by block.
#pragma once

#include <cstdint>

#include "api/points.h"
#include "core/base/result.h"
#include "core/proximity/closest_points.h"
#include "core/scene/scene.h"
#include "server/backend.h"

namespace kdray::server {

// Each gives `put` all rows in order, in at least one block, and fills the report's invalid rows
// and trace_ms. Runs in the caller's arena; `put` is called on the calling thread. Memory: that of
// a block. Errors: kCancelled, kDeadlineExceeded.

/// Normals if `options.fields` has them.
core::Status AnswerClosestPoints(const core::Scene& scene, const api::PointTable& points,
                                 const api::PointOptions& options, const core::PointOptions& query,
                                 const LoadedTree::PutRows<api::NearestPoint>& put,
                                 api::PointReport* report);
core::Status AnswerSignedDistances(const core::Scene& scene, const api::PointTable& points,
                                   const core::PointOptions& query,
                                   const LoadedTree::PutRows<double>& put,
                                   api::PointReport* report);
core::Status AnswerInside(const core::Scene& scene, const api::PointTable& points,
                          const core::PointOptions& query,
                          const LoadedTree::PutRows<std::int8_t>& put, api::PointReport* report);

}  // namespace kdray::server
