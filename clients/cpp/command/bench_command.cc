// SPDX-License-Identifier: Apache-2.0
// How fast a running daemon answers from here.
#include <array>
#include <functional>
#include <memory>
#include <ostream>

#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/load.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"
#include "clients/cpp/sample/sample_rays.h"
#include "kdray/error.h"
#include "kdray/npy.h"

namespace kdray::client {
namespace {

struct Options {
  std::string tree;
  int seconds = 2;
  int connections = 1;
  std::uint64_t rays = 100'000;
  std::string precision;
};

struct Case {
  std::string name;
  std::string unit;  // of what one request computes
  double amount = 0;
  std::function<Answer(Client&)> ask;
};

Payload RaysTowards(const Document& description, std::uint64_t count) {
  const Document bounds = description["mesh"]["bounds"];
  const auto min = bounds["min"].Numbers(), max = bounds["max"].Numbers();
  if (min.size() != 3 || max.size() != 3) {
    throw UsageError("the description of this tree has no bounds to aim at");
  }
  RaysTowardsBox rays({{min[0], min[1], min[2]}, {max[0], max[1], max[2]}}, 1);
  return Payload::OfBytes("rays", EncodeNpyHeader({.descr = "<f4", .shape = {count, 6}}) +
                                      LittleEndianFloats(rays.Next(count)));
}

std::vector<Case> CasesOf(const Options& options, const std::string& id,
                          const Document& description) {
  std::vector<Case> cases;
  Parameters precision;
  if (!options.precision.empty()) precision.emplace_back("precision", options.precision);
  const auto add_rays = [&](const std::string& query, std::uint64_t count) {
    cases.push_back(
        {query + ", " + CountText(count) + (count == 1 ? " ray" : " rays"), "rays",
         static_cast<double>(count),
         [id, query, precision, rays = RaysTowards(description, count)](Client& client) {
           return client.Query(id, "rays/" + query, precision, rays, "application/x-npy");
         }});
  };
  add_rays("closest", 1);
  add_rays("closest", 1000);
  add_rays("closest", options.rays);
  add_rays("any", options.rays);
  cases.push_back({"render 640x480", "pixels", 640.0 * 480, [id, precision](Client& client) {
                     return client.Render(id, "png", precision);
                   }});
  return cases;
}

void Bench(const Options& options, Session& session) {
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  const Document description = client.GetTree(id, 30000).description;
  const std::vector<Case> cases = CasesOf(options, id, description);

  std::vector<std::vector<std::string>> rows = {
      {"REQUEST", "REQUESTS/S", "COMPUTED/S", "MEDIAN", "99%", "TRACING"}};
  std::vector<Document> documents;
  {
    ProgressBar bar = session.Bar("measuring", 0, {});
    bar.Expect(std::chrono::duration<double>(options.seconds * static_cast<double>(cases.size())));
    for (const Case& one : cases) {
      const LoadResult result = RunLoad(client.options(), options.connections,
                                        std::chrono::duration<double>(options.seconds), one.ask);
      const double rate = result.Rate();
      const double median = LoadResult::Percentile(result.latencies_ms, 0.5);
      const double slow = LoadResult::Percentile(result.latencies_ms, 0.99);
      const double traced = LoadResult::Percentile(result.trace_ms, 0.5);
      rows.push_back({one.name, ShortText(rate), ShortText(rate * one.amount) + " " + one.unit,
                      DurationText(median), DurationText(slow), DurationText(traced)});
      documents.push_back(Document::ObjectOf(
          {{"request", Document(one.name)},
           {"requests", Document(static_cast<std::uint64_t>(result.latencies_ms.size()))},
           {"requests_per_s", Document(rate)},
           {one.unit + "_per_s", Document(rate * one.amount)},
           {"median_ms", Document(median)},
           {"p99_ms", Document(slow)},
           {"trace_ms", Document(traced)}}));
    }
  }
  if (session.json()) {
    return session.PrintJson(Document::ObjectOf(
        {{"server", Document(client.options().server.Text())},
         {"tree", Document(id)},
         {"connections", Document(static_cast<std::uint64_t>(options.connections))},
         {"seconds", Document(static_cast<std::uint64_t>(options.seconds))},
         {"results", Document::ArrayOf(documents)}}));
  }
  session.console().out << FittedTable(rows, "lrrrrr", session.console().out_columns, 1);
  session.Say(std::to_string(options.connections) +
              (options.connections == 1 ? " connection, " : " connections, ") +
              std::to_string(options.seconds) +
              " s for each row; TRACING is the median of what the server took of it");
}

}  // namespace

Subcommand BenchCommand(Session& session) {
  auto options = std::make_shared<Options>();
  return {.name = "bench",
          .help = "Measure how fast a running server answers: requests, rays and pixels a second",
          .options = {TreeOption(&options->tree),
                      {.name = "--seconds",
                       .help = "Time for each kind of request; 0 sends one of each",
                       .value = &options->seconds,
                       .type = "S",
                       .help_tells_default = true,
                       .range = Option::Range{0, 3600}},
                      {.name = "--connections",
                       .help = "Requests under way at the same time",
                       .value = &options->connections,
                       .type = "N",
                       .help_tells_default = true,
                       .range = Option::Range{1, 1000}},
                      {.name = "--rays",
                       .help = "Rays of a large batch",
                       .value = &options->rays,
                       .type = "N",
                       .help_tells_default = true,
                       .range = Option::Range{1, 4'000'000}},
                      {.name = "--precision",
                       .help = kPrecisionHelp,
                       .value = &options->precision,
                       .type = "NAME",
                       .values = SplitAtCommas(kPrecisionValues)}},
          .run = [options, &session] { Bench(*options, session); }};
}

}  // namespace kdray::client
