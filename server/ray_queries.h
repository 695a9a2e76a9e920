// SPDX-License-Identifier: Apache-2.0
// Answers batches of rays: block by block, reads the rows, calls core's tracer, and hands the hits
// to a sink.
#pragma once

#include <cstdint>

#include "api/ray_table.h"
#include "api/row_sink.h"
#include "api/types.h"
#include "core/io/mesh_attributes.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::server {

/// A batch and what is asked of it. References must outlive the call.
struct RayQuery {
  const core::Scene& scene;
  const api::RayTable& rays;
  const api::RayOptions& options;
  const core::TraceOptions& trace;
  std::size_t threads = 1;                           ///< of the arena
  const core::MeshAttributes* attributes = nullptr;  ///< those that the options' fields need
};

// Each hands every row to the sink and fills the report's lists of rows and its times. Runs in the
// caller's arena. Problems: those of the sink, and deadline_exceeded or draining when
// `trace.cancel` stops; the answer is then incomplete. Memory: some blocks of rays, whatever the
// batch's size.

api::Check AnswerClosest(const RayQuery& query, api::RowSink<api::ClosestRows>* sink,
                         api::BatchReport* report);
api::Check AnswerAny(const RayQuery& query, api::RowSink<api::AnyRows>* sink,
                     api::BatchReport* report);
api::Check AnswerCount(const RayQuery& query, api::RowSink<api::CountRows>* sink,
                       api::BatchReport* report);
/// too_many_hits beyond `most_hits` hits of all rows.
api::Check AnswerAll(const RayQuery& query, std::uint64_t most_hits,
                     api::RowSink<api::AllRows>* sink, api::BatchReport* report);

}  // namespace kdray::server
