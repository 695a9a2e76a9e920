// SPDX-License-Identifier: Apache-2.0
// Answers render requests: makes core's specification of a request, calls core's renderer, and
// encodes the picture.
#pragma once

#include "api/limits.h"
#include "api/types.h"
#include "core/base/cancel.h"
#include "core/io/mesh_attributes.h"
#include "core/scene/scene.h"

namespace kdray::server {

/// The attributes of the mesh's file that a picture needs.
core::AttributeKinds AttributesFor(const api::RenderRequest& request);

/// References must outlive the call.
struct RenderQuery {
  const core::Scene& scene;
  const core::MeshAttributes* attributes;  ///< of AttributesFor the request; may be null without
  const api::Limits& limits;
  const api::RenderRequest& request;
  bool png;  ///< whether the answer is a PNG, or an array of numbers
  const core::CancelToken& cancel;
};

/// Fills the picture, what was modelled and the times. Runs in the caller's arena. Problems:
/// too_many_cells, core's, and deadline_exceeded or draining when `cancel` stops.
api::Check AnswerRender(const RenderQuery& query, api::RenderAnswer* answer);

}  // namespace kdray::server
