// A mesh's measured trade-off as a table for people.
#pragma once

#include <string>

#include "clients/cpp/client/document.h"

namespace kdray::client {

/// A row for every build with every precision, and a line about the conditions. Missing values are
/// blank.
std::string TradeoffText(const Document& tradeoff);

}  // namespace kdray::client
