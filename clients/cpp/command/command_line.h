// SPDX-License-Identifier: Apache-2.0
// The one description of the program that the parser, the help, the manual page and the completions
// are made of.
#pragma once

#include <string>
#include <vector>

#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"

namespace kdray::client {

struct CommandLine {
  std::string summary;  ///< one sentence
  std::string footer;   ///< end of the help
  std::vector<Option> options;
  std::vector<Subcommand> subcommands;

  const Subcommand* Find(const std::string& name) const;
};

/// `session` must live as long as the command line. It includes `completion` and `man`, which print
/// what is made of it.
CommandLine MakeCommandLine(Session& session);

/// The names of an option without its dashes are those that a user may write: `-o,--output` gives
/// `-o` and `--output`.
std::vector<std::string> NamesOf(const Option& option);

/// Whether the option is given by its position.
bool IsPositional(const Option& option);

/// Whether a value follows its name.
bool TakesValue(const Option& option);

/// Its value in the help and the manual: the type, or the name in capitals.
std::string ValueName(const Option& option);

}  // namespace kdray::client
