// SPDX-License-Identifier: Apache-2.0
// Completions of shells, made from the description of the command line.
#pragma once

#include <string>

#include "clients/cpp/command/command_line.h"

namespace kdray::client {

/// A script for bash 4 and later, with or without the package bash-completion.
std::string BashCompletion(const CommandLine& line);

/// A file `_kdray` for a folder of zsh's fpath.
std::string ZshCompletion(const CommandLine& line);

/// A file for fish's folder of completions.
std::string FishCompletion(const CommandLine& line);

}  // namespace kdray::client
