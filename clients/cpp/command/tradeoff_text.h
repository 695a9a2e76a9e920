// SPDX-License-Identifier: Apache-2.0
// A mesh's measured trade-off as a table for people.
#pragma once

#include <cstddef>
#include <string>

#include "kdray/document.h"

namespace kdray::client {

/// A row for every build with every precision, and a line about the conditions. Missing values are
/// blank. A table that is wider than `width` becomes several; a `width` of 0 is unlimited.
std::string TradeoffText(const Document& tradeoff, std::size_t width);

/// "12 triangles, closed; 2 threads, load 0.5, other work beside 1 of 48 runs; measured
/// 2024-05-17".
std::string TradeoffConditions(const Document& tradeoff);

}  // namespace kdray::client
