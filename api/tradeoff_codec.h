// The measured trade-off of a mesh as JSON text.
#pragma once

#include <string>

#include "api/types.h"

namespace kdray::api {

/// One row for every build with every precision. A rate of 0 has `below`, its bound at 95%
/// confidence. UTF-8, no line breaks.
std::string EncodeTradeoff(const Tradeoff& tradeoff);

}  // namespace kdray::api
