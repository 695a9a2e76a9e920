// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <ostream>

#include "clients/cpp/command/ending.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/progress_bar.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/tradeoff_plot.h"
#include "clients/cpp/command/tradeoff_text.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

struct Options {
  std::string tree;
  bool again = false;
  bool forget = false;
  std::string plot;
};

// Wait of one request, short enough for a moving bar.
constexpr int kLookAgainMs = 500;

Tradeoff Measure(Client& client, const std::string& id, bool again, Session& session) {
  std::optional<Tradeoff> tradeoff;
  if (!again) tradeoff = client.FindTradeoff(id);
  if (!tradeoff) tradeoff = client.MeasureTradeoff(id, kLookAgainMs);
  ProgressBar measuring = session.Bar("measuring", 1, {});
  while (!tradeoff->ready) {
    measuring.Update(tradeoff->progress);
    tradeoff = client.FindTradeoff(id, kLookAgainMs);
    if (!tradeoff) throw UsageError("the measurement was stopped");
  }
  return *tradeoff;
}

void Run(const Options& options, Session& session) {
  std::optional<OutputFile> plot;
  if (!options.plot.empty()) {
    session.RefuseJsonBeside(options.plot);
    TypeOfOutput(options.plot, {"png"});
    plot.emplace(options.plot, session.console());
  }
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  if (options.forget) {
    client.ForgetTradeoff(id);
    session.Say("forgotten");
    return;
  }
  const Tradeoff tradeoff = Measure(client, id, options.again, session);
  if (plot) {
    plot->Write(DrawPng(PlotOf(tradeoff.document)));
    plot->Commit();
  }
  if (session.json()) {
    session.PrintJson(tradeoff.document);
  } else if (options.plot != "-") {
    const std::size_t width = session.console().out_columns;
    session.console().out << Printable(TradeoffText(tradeoff.document, width));
  }
}

}  // namespace

Subcommand TradeoffCommand(Session& session) {
  auto options = std::make_shared<Options>();
  return {
      .name = "tradeoff",
      .help = "Measure speed and accuracy on a mesh: every build with every precision",
      .options = {TreeOption(&options->tree),
                  {.name = "--again",
                   .help = "Measure even if it was measured before",
                   .value = &options->again},
                  {.name = "--forget",
                   .help = "Stop measuring, and delete the result",
                   .value = &options->forget},
                  {.name = "--plot",
                   .help = "Also draw the leaks and errors over the speed: .png, or - for standard "
                           "output instead of the table",
                   .value = &options->plot,
                   .type = "FILE"}},
      .run = [options, &session] { Run(*options, session); }};
}

}  // namespace kdray::client
