// Batches in .npy arrays: the last dimension is a row, the others are the batch's leading shape.
#pragma once

#include <cstdint>

#include "api/npy.h"
#include "api/should_stop.h"
#include "api/types.h"

namespace kdray::api {

/// Rays from an array of shape (…, 6) or (…, 8); rows of 6 get `t_min` and `t_max`. Rows are
/// numbered in C order of the leading shape, also for a Fortran array. invalid_array for another
/// last dimension, too_many_rays. When `should_stop` does, any problem comes back.
Outcome<RayTable> RaysFromNpy(const NpyArray& array, double t_min, double t_max,
                              std::uint64_t max_rows, const ShouldStop& should_stop = {});

}  // namespace kdray::api
