// SPDX-License-Identifier: Apache-2.0
// Decodes pairs of point sets, and encodes which points see each other, as JSON
// or .npy.
#pragma once

#include <string>
#include <string_view>

#include "api/batch_type.h"
#include "api/batch_work.h"
#include "api/limits.h"
#include "api/should_stop.h"
#include "api/types.h"
#include "api/visibility.h"

namespace kdray::api {

/// Reads `{"from": [[x, y, z],…], "to": […]}`, or a .npy array of shape (…, 3)
/// whose first `options.from_count` rows are `from`. Errors as DecodePoints
/// (api/point_codec.h); too_many_rays beyond `limits.max_rays` points of a set,
/// or pairs; invalid_parameter if from_count is missing, is more than the array
/// has rows, or is given for JSON. Memory: 24 bytes a point, and for .npy as many again while it
/// reads; charged before it is taken.
Outcome<PointSets> DecodePointSets(std::string_view body, BatchType type,
                                   const VisibilityOptions& options, const Limits& limits,
                                   const BatchWork& work = {});

/// invalid_parameter for `bits` in JSON.
Check CheckAnswerType(const VisibilityOptions& options, BatchType type);

/// npy: `|b1` of shape (from, to), or with `bits` `|u1` of shape (from, ceil(to
/// / 8)) in the order of numpy.packbits. JSON: `{"visible": [[…],…], "invalid":
/// […]}` of booleans. Empty once `should_stop` has returned true.
std::string EncodeVisibility(const VisibilityAnswer& answer, const PointSets& sets,
                             const VisibilityOptions& options, BatchType type,
                             const ShouldStop& should_stop = {});

}  // namespace kdray::api
