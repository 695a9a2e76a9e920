#include <algorithm>
#include <array>

#include "clients/cpp/client/error.h"
#include "clients/cpp/client/npy.h"
#include "clients/cpp/command/answer_text.h"
#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

constexpr std::array kOptionNames = {"precision", "fields", "t_min",
                                     "t_max",     "dtype",  "deadline_ms"};

struct Options {
  std::string tree;
  std::string rays;
  std::string output;
  bool any = false;
  std::array<std::string, kOptionNames.size()> values;
};

// Checks the file before it is sent, so an error (two arrays mixed up) names the file. The server
// checks JSON and reports the line.
std::string DescribeRays(const LocalFile& rays) {
  std::string head(std::min<std::uint64_t>(rays.size(), 4096), '\0');
  rays.Read(0, head);
  if (!head.starts_with(kNpyMagic)) {
    const std::size_t first = head.find_first_not_of(" \t\r\n");
    if (first != std::string::npos && head[first] == '{') return "rays";
    throw LocalFileError(rays.path() + R"(: neither a .npy array nor JSON {"rays": [[…],…]})");
  }
  NpyHeader header;
  try {
    header = ParseNpyHeader(head);
  } catch (const LocalFileError& error) {
    throw LocalFileError(rays.path() + ": " + error.what());
  }
  const std::uint64_t columns = header.shape.empty() ? 0 : header.shape.back();
  if ((header.descr != "<f4" && header.descr != "<f8") || (columns != 6 && columns != 8))
    throw LocalFileError(rays.path() + ": rays are <f4 or <f8 with 6 or 8 columns; this is " +
                         header.descr + " with " + std::to_string(columns));
  return CountText(header.ElementCount() / columns) + " rays";
}

void QueryRays(const Options& options, Session& session) {
  const bool is_json = options.output.ends_with(".json");
  const LocalFile rays(options.rays);
  const std::string what = DescribeRays(rays);
  Parameters parameters;
  for (std::size_t i = 0; i < kOptionNames.size(); ++i)
    if (!options.values[i].empty()) parameters.emplace_back(kOptionNames[i], options.values[i]);

  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  const Answer answer = client.QueryRays(id, options.any ? "any" : "closest", parameters, rays,
                                         is_json ? "application/json" : "application/x-npy");
  file.Write(answer.body);
  file.Commit();
  session.Say(options.output + ": " + what + ", " + AnswerText(answer.response));
}

}  // namespace

void AddRays(CLI::App& app, Session& session) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "rays", "Closest hits of a batch of rays; rows are ox oy oz dx dy dz, or with t_min t_max");
  command->add_option("tree", options->tree, "Tree, or a mesh file to upload first")
      ->required()
      ->type_name("ID|FILE");
  command->add_option("rays", options->rays, "Rays: .npy of shape (…,6) or (…,8), or JSON")
      ->required()
      ->type_name("RAYS");
  command->add_option("-o,--output", options->output, "Hits to write: .npy, .json, or - (.npy)")
      ->required()
      ->type_name("FILE");
  command->add_flag("--any", options->any, "Only whether something is hit, which is quicker");
  constexpr std::array kHelp = {
      kPrecisionHelp,
      "t, triangle, u, v, normal or point of a hit, comma-separated: t,triangle,u,v when left out",
      "Nearest t that counts: 0 when left out",
      "Farthest t that counts",
      "f4 or f8: the answer's numbers; those of the rays when left out",
      "Give up after that time: 30000 when left out"};
  constexpr std::array kTypes = {"NAME", "NAMES", "T", "T", "NAME", "MS"};
  for (std::size_t i = 0; i < kOptionNames.size(); ++i) {
    std::string name = std::string("--") + kOptionNames[i];
    std::replace(name.begin(), name.end(), '_', '-');
    command->add_option(name, options->values[i], kHelp[i])->type_name(kTypes[i]);
  }
  command->callback([options, &session] { QueryRays(*options, session); });
}

}  // namespace kdray::client
