#include "clients/cpp/command/command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ostream>
#include <type_traits>
#include <variant>
#include <vector>

#include "clients/cpp/client/error.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"

namespace kdray::client {
namespace {

constexpr const char* kFooter =
    "An ID may be shortened to its first six digits or more. In place of an ID, render and rays\n"
    "also take a mesh file, which is uploaded first if the server does not have it.\n"
    "\n"
    "Exit codes: 0 success, 1 the server's error, 2 invalid usage, 3 no connection, 4 a local "
    "file.";

// The first line is `kdray: …`; further lines are indented.
int Complain(Console& console, const std::exception& error, int code) {
  console.err << "kdray: " << Printable(error.what()) << "\n";
  return code;
}

void Require(CLI::Option& added, const Option& option) {
  if (option.required) added.required();
  if (!option.type.empty()) added.type_name(option.type);
  if (option.help_tells_default) added.capture_default_str();
  if (option.last_wins) added.take_last();
  if (!option.environment.empty()) added.envname(option.environment);
  if (!option.choices.empty()) added.check(CLI::IsMember(option.choices));
  if (option.count) added.expected(*option.count);
  if (option.split_at_commas) added.delimiter(',');
}

// The template parameter of CLI::Range, which its help names, is the type of the value.
template <typename T>
void Add(CLI::App& app, const Option& option, T& value) {
  if constexpr (std::is_same_v<T, bool>) {
    app.add_flag(option.name, value, option.help);
  } else {
    CLI::Option* added = app.add_option(option.name, value, option.help);
    if constexpr (std::is_integral_v<T>)
      if (option.range)
        added->check(
            CLI::Range(static_cast<T>(option.range->min), static_cast<T>(option.range->max)));
    Require(*added, option);
  }
}

void Add(CLI::App& app, const std::vector<Option>& options) {
  for (const Option& option : options)
    std::visit([&](auto* value) { Add(app, option, *value); }, option.value);
}

void Add(CLI::App& app, Subcommand subcommand) {
  CLI::App* added = app.add_subcommand(subcommand.name, subcommand.help);
  if (!subcommand.footer.empty()) added->footer(subcommand.footer);
  Add(*added, subcommand.options);
  added->callback(std::move(subcommand.run));
}

}  // namespace

int RunCommand(std::span<const std::string> arguments, Console console) {
  CLI::App app("Ray queries and renders of meshes, by a kdrayd server.", "kdray");
  app.set_version_flag("--version", "kdray " KDRAY_VERSION);
  app.require_subcommand(1);
  app.fallthrough();  // general options may also follow the subcommand
  app.footer(kFooter);
  Session session(console);
  Add(app, session.Options());
  Add(app, UploadCommand(session));
  Add(app, RenderCommand(session));
  Add(app, RaysCommand(session));
  Add(app, PointsCommand(session));
  for (Subcommand& subcommand : TreeCommands(session)) Add(app, std::move(subcommand));
  Add(app, TradeoffCommand(session));
  for (Subcommand& subcommand : SampleCommands(session)) Add(app, std::move(subcommand));

  try {
    std::vector<std::string> reversed(arguments.rbegin(), arguments.rend());  // as CLI11 wants them
    app.parse(std::move(reversed));
    console.out.flush();
    if (!console.out) throw LocalFileError("standard output: cannot be written");
    return kExitOk;
  } catch (const CLI::ParseError& error) {
    return app.exit(error, console.out, console.err) == 0 ? kExitOk : kExitUsage;
  } catch (const Refusal& error) {
    return Complain(console, error, kExitRefused);
  } catch (const UsageError& error) {
    return Complain(console, error, kExitUsage);
  } catch (const ConnectionError& error) {
    return Complain(console, error, kExitConnection);
  } catch (const LocalFileError& error) {
    return Complain(console, error, kExitLocalFile);
  }
}

}  // namespace kdray::client
