#include <ostream>

#include "clients/cpp/client/error.h"
#include "clients/cpp/command/progress_bar.h"
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

}  // namespace

void AddTradeoff(CLI::App& app, Session& session) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "tradeoff", "Measure speed and accuracy on a mesh: every build with every precision");
  command->add_option("tree", options->tree, "Tree, whole id or its beginning, or a mesh file")
      ->required()
      ->type_name("ID|FILE");
  command->add_flag("--again", options->again, "Measure even if it was measured before");
  command->add_flag("--forget", options->forget, "Stop measuring, and delete the result");
  command->add_flag("--json", options->json, "As the server gives it");
  command->callback([options, &session] {
    Client client = session.Connect();
    const std::string id = session.TreeIdFor(client, options->tree);
    if (options->forget) {
      client.ForgetTradeoff(id);
      session.Say("forgotten");
      return;
    }
    const Tradeoff tradeoff = Measure(client, id, options->again, session);
    session.console().out << (options->json ? tradeoff.document.dump(2) + "\n"
                                            : Printable(TradeoffText(tradeoff.document)));
  });
}

}  // namespace kdray::client
