// SPDX-License-Identifier: Apache-2.0
// The fast reader of JSON batches, for the form in which programs write them. Whatever else is in
// a text, valid or not, is left to api/json_batch.cc, which knows all of JSON and names the place
// of an error.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "api/batch_work.h"
#include "api/ray_table.h"

namespace kdray::api {

/// Reads `{"rays": [[…],…]}`: rows of 6 or 8 numbers, null as the eighth, blanks between. The text
/// is cut between rows, and `work.run` reads the parts at the same time. nullopt if the text has
/// any other form, has more than `max_rows` rows, or the work was stopped; a problem only from
/// work.charge, which is asked for the rows' memory.
Outcome<std::optional<RayTable>> ReadPlainRays(std::string_view json, double t_min, double t_max,
                                               std::uint64_t max_rows, const BatchWork& work);

}  // namespace kdray::api
