// SPDX-License-Identifier: Apache-2.0
// The manual page kdray(1), made from the description of the command line.
#pragma once

#include <string>

#include "clients/cpp/command/command_line.h"

namespace kdray::client {

/// The page in the man macros of roff. Source: man(7).
std::string ManualPage(const CommandLine& line);

}  // namespace kdray::client
