#include "clients/cpp/command/command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ostream>
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

}  // namespace

int RunCommand(std::span<const std::string> arguments, Console console) {
  CLI::App app("Ray queries and renders of meshes, by a kdrayd server.", "kdray");
  app.set_version_flag("--version", "kdray " KDRAY_VERSION);
  app.require_subcommand(1);
  app.fallthrough();  // general options may also follow the subcommand
  app.footer(kFooter);
  Session session(console);
  session.AddOptions(app);
  AddUpload(app, session);
  AddRender(app, session);
  AddRays(app, session);
  AddTreeCommands(app, session);
  AddTradeoff(app, session);
  AddSamples(app, session);

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
