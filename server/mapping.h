// SPDX-License-Identifier: Apache-2.0
// Converts between the contract's types (api) and core's; no other file does.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "api/errors.h"
#include "api/points.h"
#include "api/types.h"
#include "core/accel/build_kind.h"
#include "core/accel/tree_cell.h"
#include "core/base/result.h"
#include "core/catalog/records.h"
#include "core/catalog/tree_id.h"
#include "core/geometry/hit.h"
#include "core/geometry/ray.h"
#include "core/intersect/hit_filter.h"
#include "core/intersect/precision.h"
#include "core/library/tree_library.h"
#include "core/proximity/closest_points.h"
#include "core/proximity/sides.h"
#include "core/render/renderer.h"

namespace kdray::server {

/// `not_found` is the code for kNotFound. Internal errors become `internal` without a cause, except
/// for a damaged mesh, which says how to repair it.
api::Problem ToProblem(const core::Error& error,
                       api::ErrorCode not_found = api::ErrorCode::kTreeNotFound);

api::Check ToCheck(const core::Status& status);

/// `parameter` names the depth in the request; `limit` is the most cells that an answer holds.
api::Problem TooManyCells(std::string_view parameter, std::int64_t depth, std::uint64_t limit);

/// nullopt for `auto`.
std::optional<core::BuildKind> ToCore(api::Build build);
api::Build ToApi(core::BuildKind build);

/// `automatic` is the precision of `auto` for the mesh.
core::Precision ToCore(api::Precision precision, core::Precision automatic);
api::Precision ToApi(core::Precision precision);
core::Cull ToCore(api::Cull cull);

/// `automatic` is the precision of `auto` for the query.
core::PointPrecision ToCore(api::PointPrecision precision, core::PointPrecision automatic);
api::Precision ToApi(core::PointPrecision precision);

/// tree_not_found for an invalid id.
api::Outcome<core::TreeId> ToTreeId(std::string_view id);

api::TreeDescription ToApi(const core::TreeInfo& info);

/// A place in the list as the opaque `after`; nullopt if the text is not one of our cursors.
std::string FormatCursor(const core::TreeInfo& info);
std::optional<core::TreeLibrary::Position> ParseCursor(std::string_view cursor);

/// The same hits: both structures have the same numbers at the same places.
inline std::span<const api::RayHit> ToApi(std::span<const core::Hit> hits) {
  static_assert(sizeof(api::RayHit) == sizeof(core::Hit) &&
                offsetof(api::RayHit, t) == offsetof(core::Hit, t) &&
                offsetof(api::RayHit, u) == offsetof(core::Hit, u) &&
                offsetof(api::RayHit, v) == offsetof(core::Hit, v) &&
                offsetof(api::RayHit, triangle) == offsetof(core::Hit, primitive_id) &&
                static_cast<std::int32_t>(core::kNoPrimitive) == -1);
  return {reinterpret_cast<const api::RayHit*>(hits.data()), hits.size()};
}

core::Light ToCore(const api::Light& light);
/// RenderSpec::precision is nullopt for `auto`.
core::RenderSpec ToCore(const api::RenderRequest& request);
api::Stopped ToApi(core::Stopped stopped);
api::RenderCounts ToApi(const core::RenderCounts& counts);
api::ImageArray ToApi(core::RenderedImage image);
api::Cell ToApi(const core::TreeCell& cell);
api::Tradeoff ToApi(const core::MeasuredTradeoff& measured);

}  // namespace kdray::server
