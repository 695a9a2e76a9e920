// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/command_line.h"

#include <algorithm>
#include <cctype>
#include <memory>
#include <ostream>

#include "clients/cpp/command/completion.h"
#include "clients/cpp/command/manual.h"

namespace kdray::client {
namespace {

constexpr const char* kFooter =
    "An ID may be shortened to its first six digits or more. In place of an ID, most commands "
    "also\n"
    "take a mesh file, which is uploaded first if the server does not have it. - is standard "
    "input\n"
    "or output; the ending of an output file decides what is written.\n"
    "\n"
    "Exit codes: 0 success, 1 the server's error, 2 invalid usage, 3 no connection, 4 a local "
    "file.";

Subcommand CompletionCommand(Session& session) {
  auto shell = std::make_shared<std::string>();
  return {.name = "completion",
          .help = "Print a shell's completion of this command",
          .options = {{.name = "shell",
                       .help = "bash, zsh or fish",
                       .value = shell.get(),
                       .type = "SHELL",
                       .required = true,
                       .choices = {"bash", "zsh", "fish"}}},
          .footer =
              "  source <(kdray completion bash)\n"
              "  kdray completion zsh > \"${fpath[1]}/_kdray\"\n"
              "  kdray completion fish > ~/.config/fish/completions/kdray.fish",
          .run = [shell, &session] {
            const CommandLine line = MakeCommandLine(session);
            session.console().out << (*shell == "bash"  ? BashCompletion(line)
                                      : *shell == "zsh" ? ZshCompletion(line)
                                                        : FishCompletion(line));
          }};
}

Subcommand ManCommand(Session& session) {
  return {.name = "man",
          .help = "Print the manual page, for `man -l -`",
          .options = {},
          .run = [&session] { session.console().out << ManualPage(MakeCommandLine(session)); }};
}

}  // namespace

const Subcommand* CommandLine::Find(const std::string& name) const {
  const auto found = std::find_if(subcommands.begin(), subcommands.end(),
                                  [&](const Subcommand& known) { return known.name == name; });
  return found == subcommands.end() ? nullptr : &*found;
}

CommandLine MakeCommandLine(Session& session) {
  CommandLine line = {.summary = "Ray queries and renders of meshes, by a kdrayd server.",
                      .footer = kFooter,
                      .options = session.Options(),
                      .subcommands = {}};
  const auto add = [&](Subcommand subcommand) {
    line.subcommands.push_back(std::move(subcommand));
  };
  add(UploadCommand(session));
  add(RenderCommand(session));
  add(RaysCommand(session));
  add(PointsCommand(session));
  add(VisibilityCommand(session));
  add(ScanCommand(session));
  for (Subcommand& subcommand : TreeCommands(session)) add(std::move(subcommand));
  add(TradeoffCommand(session));
  add(BenchCommand(session));
  for (Subcommand& subcommand : SampleCommands(session)) add(std::move(subcommand));
  add(CompletionCommand(session));
  add(ManCommand(session));
  return line;
}

std::vector<std::string> NamesOf(const Option& option) { return SplitAtCommas(option.name); }

bool IsPositional(const Option& option) { return !option.name.starts_with('-'); }

bool TakesValue(const Option& option) { return !std::holds_alternative<bool*>(option.value); }

std::string ValueName(const Option& option) {
  if (!option.type.empty()) return option.type;
  std::string name = option.name;
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return name;
}

}  // namespace kdray::client
