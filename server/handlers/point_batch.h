// SPDX-License-Identifier: Apache-2.0
// How the queries of points and of visibility begin: with a body that is read whole. Batches of
// rays, which may be decoded while they arrive, have ray_body.h.
#pragma once

#include "api/batch_type.h"
#include "server/handler.h"
#include "server/handlers/answers.h"
#include "server/handlers/request_cost.h"

namespace kdray::server {

struct PointBatch {
  RequestBody body;
  api::BatchType type;
  api::BatchType answer_type;
};

/// Finds the tree, reads the body, and chooses the form of the answer. tree_not_found, the problems
/// of ReadWholeBody(), unsupported_media_type or not_acceptable.
api::Outcome<PointBatch> ReadPointBatch(const HandlerContext& context, const RoutedRequest& routed,
                                        const WorkOfBody& work);

}  // namespace kdray::server
