#include <memory>
#include <ostream>

#include "clients/cpp/client/error.h"
#include "clients/cpp/command/progress_bar.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/tradeoff_text.h"

namespace kdray::client {
namespace {

struct Options {
  std::string tree;
  bool again = false;
  bool forget = false;
  bool json = false;
};

// Wait of one request, short enough for a moving bar.
constexpr int kLookAgainMs = 500;

Tradeoff Measure(Client& client, const std::string& id, bool again, Session& session) {
  std::optional<Tradeoff> tradeoff;
  if (!again) tradeoff = client.FindTradeoff(id);
  if (!tradeoff) tradeoff = client.MeasureTradeoff(id, kLookAgainMs);
  ProgressBar measuring(session.console(), "measuring", 0, session.quiet());
  while (!tradeoff->ready) {
    measuring.Update(tradeoff->progress);
    tradeoff = client.FindTradeoff(id, kLookAgainMs);
    if (!tradeoff) throw UsageError("the measurement was stopped");
  }
  return *tradeoff;
}

void Run(const Options& options, Session& session) {
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  if (options.forget) {
    client.ForgetTradeoff(id);
    session.Say("forgotten");
    return;
  }
  const Tradeoff tradeoff = Measure(client, id, options.again, session);
  session.console().out << (options.json ? tradeoff.document.Indented() + "\n"
                                         : Printable(TradeoffText(tradeoff.document)));
}

}  // namespace

Subcommand TradeoffCommand(Session& session) {
  auto options = std::make_shared<Options>();
  return {
      .name = "tradeoff",
      .help = "Measure speed and accuracy on a mesh: every build with every precision",
      .options = {{.name = "tree",
                   .help = "Tree, whole id or its beginning, or a mesh file",
                   .value = &options->tree,
                   .type = "ID|FILE",
                   .required = true},
                  {.name = "--again",
                   .help = "Measure even if it was measured before",
                   .value = &options->again},
                  {.name = "--forget",
                   .help = "Stop measuring, and delete the result",
                   .value = &options->forget},
                  {.name = "--json", .help = "As the server gives it", .value = &options->json}},
      .run = [options, &session] { Run(*options, session); }};
}

}  // namespace kdray::client
