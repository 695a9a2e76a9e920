// What was measured on a mesh, as a table for people.
#pragma once

#include <string>

#include "clients/cpp/client/client.h"

namespace kdray::client {

/// A row for every build with every precision, and a line about the conditions. What the answer
/// lacks is left blank.
std::string TradeoffText(const Json& tradeoff);

}  // namespace kdray::client
