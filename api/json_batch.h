// SPDX-License-Identifier: Apache-2.0
// Reads JSON batches into rows, in one pass and without a document tree.
#pragma once

#include <cstdint>
#include <string_view>

#include "api/batch_work.h"
#include "api/ray_table.h"
#include "api/types.h"

namespace kdray::api {

/// Reads `{"rays": [[ox, oy, oz, dx, dy, dz], [ox, oy, oz, dx, dy, dz, t_min, t_max], …]}`. Rows of
/// 6 get the `t_min` and `t_max` given here; a t_max of null is infinity. invalid_json for anything
/// else, with the JSON pointer of the row or number; invalid_parameter for a field other than
/// `rays`; too_many_rays at row `max_rows` + 1. Deep nesting costs nothing: the first bracket too
/// many is an error. When `work.should_stop` returns true, any problem comes back.
/// The rows' memory is charged before it is taken.
Outcome<RayTable> ReadRayRows(std::string_view json, double t_min, double t_max,
                              std::uint64_t max_rows, const BatchWork& work = {});

}  // namespace kdray::api
