// The two forms of the answer of rays/closest.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "api/should_stop.h"
#include "api/types.h"

namespace kdray::api {

/// `numbers` is the type of t, u, v, normal and point: in JSON their text is the shortest that
/// reads back as that type. A hit's numbers are finite: a number beyond the type's range becomes
/// its largest finite number, so a hit never looks like a miss. No number is -0. Empty once
/// `should_stop` has returned true.
std::string ClosestAsJson(const ClosestAnswer& answer, const std::vector<RayField>& fields,
                          NumberType numbers, const ShouldStop& should_stop);
std::string ClosestAsNpy(const ClosestAnswer& answer, const std::vector<RayField>& fields,
                         NumberType numbers, const std::vector<std::size_t>& leading_shape,
                         const ShouldStop& should_stop);

}  // namespace kdray::api
