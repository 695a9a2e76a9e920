#include <algorithm>
#include <array>
#include <memory>

#include "clients/cpp/client/error.h"
#include "clients/cpp/client/npy.h"
#include "clients/cpp/command/answer_text.h"
#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

constexpr std::array kFields = {
    Field{"precision", "NAME", kPrecisionHelp},
    Field{"fields", "NAMES",
          "t, triangle, u, v, normal, point, side, group, uv or shading_normal of a hit, "
          "comma-separated: t,triangle,u,v when left out"},
    Field{"max_hits", "N", "Hits of a ray with --all, at most, the nearest: 64 when left out"},
    Field{"t_min", "T",
          "Nearest t that counts, or auto for rays that begin on the mesh: 0 when left out"},
    Field{"t_max", "T", "Farthest t that counts, or auto for segments that end on the mesh"},
    Field{"cull", "NAME", "none, back or front: sides that are no hits; none when left out"},
    Field{"dtype", "NAME", "f4 or f8: the answer's numbers; those of the rays when left out"},
    Field{"deadline_ms", "MS", "Give up after that time: 30000 when left out"},
};

struct Options {
  std::string tree;
  std::string rays;
  std::string output;
  bool any = false, count = false, all = false;
  std::array<std::string, kFields.size()> values;
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

std::string QueryOf(const Options& options) {
  if (options.any + options.count + options.all > 1) {
    throw UsageError("--any, --count and --all exclude each other");
  }
  return options.any ? "any" : options.count ? "count" : options.all ? "all" : "closest";
}

void QueryRays(const Options& options, Session& session) {
  const bool is_json = options.output.ends_with(".json");
  const LocalFile rays(options.rays);
  const std::string what = DescribeRays(rays);
  Parameters parameters;
  for (std::size_t i = 0; i < kFields.size(); ++i)
    if (!options.values[i].empty()) parameters.emplace_back(kFields[i].name, options.values[i]);

  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  const Answer answer = client.QueryRays(id, QueryOf(options), parameters, rays,
                                         is_json ? "application/json" : "application/x-npy");
  file.Write(answer.body);
  file.Commit();
  session.Say(options.output + ": " + what + ", " + AnswerText(answer.response));
}

}  // namespace

Subcommand RaysCommand(Session& session) {
  auto options = std::make_shared<Options>();
  Subcommand command = {
      .name = "rays",
      .help = "Closest hits of a batch of rays; rows are ox oy oz dx dy dz, or with t_min t_max",
      .options = {{.name = "tree",
                   .help = "Tree, or a mesh file to upload first",
                   .value = &options->tree,
                   .type = "ID|FILE",
                   .required = true},
                  {.name = "rays",
                   .help = "Rays: .npy of shape (…,6) or (…,8), or JSON",
                   .value = &options->rays,
                   .type = "RAYS",
                   .required = true},
                  {.name = "-o,--output",
                   .help = "Hits to write: .npy, .json, or - (.npy)",
                   .value = &options->output,
                   .type = "FILE",
                   .required = true},
                  {.name = "--any",
                   .help = "Only whether something is hit, which is quicker",
                   .value = &options->any},
                  {.name = "--count",
                   .help = "Only how many triangles are hit; odd from inside a closed mesh",
                   .value = &options->count},
                  {.name = "--all",
                   .help = "All hits; .npy: one list, with the number of the ray",
                   .value = &options->all}},
      .run = [options, &session] { QueryRays(*options, session); }};
  for (std::size_t i = 0; i < kFields.size(); ++i)
    command.options.push_back(FieldOption(kFields[i], &options->values[i]));
  return command;
}

}  // namespace kdray::client
