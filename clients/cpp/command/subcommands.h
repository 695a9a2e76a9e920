// SPDX-License-Identifier: Apache-2.0
// The subcommands of `kdray`, as data: what they are called, their options, and what they do.
// command.cc gives them to CLI11, which no other file includes.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "kdray/server_url.h"

namespace kdray::client {

class Session;

/// An option, a flag or an argument by position.
struct Option {
  /// Where its value goes; it keeps its initial value if the option is not given. A bool is a flag.
  using Target = std::variant<bool*, int*, std::uint32_t*, std::uint64_t*, std::string*,
                              std::vector<std::string>*, std::vector<double>*>;
  struct Range {
    std::uint64_t min, max;  ///< both included
  };

  std::string name;  ///< `-o,--output`; without a dash it is an argument by position: `tree`
  std::string help;
  Target value;
  std::string type = {};  ///< how the help calls the value: `FILE`
  bool required = false;
  bool help_tells_default = false;
  bool last_wins = false;                 ///< if it is given twice, which is an error otherwise
  std::string environment = {};           ///< variable that sets it if the command line does not
  std::optional<Range> range = {};        ///< of an int or a count
  std::vector<std::string> choices = {};  ///< the values allowed, if not empty
  std::vector<std::string> values = {};   ///< values known; the server may know others
  std::optional<int> count = {};          ///< how many values a vector takes; any number otherwise
  bool split_at_commas = false;
  bool may_be_empty = false;  ///< an empty value is as good as none, and no mistake
};

/// A field of a request that an option sets. The text is sent unchanged; the server checks it.
struct Field {
  const char* name;  ///< as in the contract: `t_min`; the option is `--t-min`
  const char* type;
  const char* help;
  const char* values = "";  ///< known values, comma-separated
};

/// The parameters of a request: the fields whose values are not empty. @pre equally many.
Parameters ParametersOf(std::span<const Field> fields, std::span<const std::string> values);

/// The words of "a,b,c".
std::vector<std::string> SplitAtCommas(std::string_view text);

struct Subcommand {
  std::string name;
  std::string help;
  std::vector<Option> options;
  std::string footer = {};    ///< end of its help; that of `kdray --help` if empty
  std::function<void()> run;  ///< called when all options have their values; may throw
};

/// The argument `tree` of commands that ask a tree, or upload a mesh first.
Option TreeOption(std::string* value);

/// Adds an option for each field. @pre at least as many values.
void AddFieldOptions(Subcommand* command, std::span<const Field> fields,
                     std::span<std::string> values);

// `session` must live as long as what these return.
Subcommand UploadCommand(Session& session);
Subcommand RenderCommand(Session& session);
Subcommand RaysCommand(Session& session);
Subcommand PointsCommand(Session& session);
Subcommand VisibilityCommand(Session& session);
Subcommand ScanCommand(Session& session);
Subcommand BenchCommand(Session& session);
std::vector<Subcommand> TreeCommands(Session& session);  ///< list, show, delete, cells, mesh
Subcommand TradeoffCommand(Session& session);
std::vector<Subcommand> SampleCommands(Session& session);  ///< sample, sample-rays

}  // namespace kdray::client
