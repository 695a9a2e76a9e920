#include <algorithm>
#include <array>
#include <memory>

#include "clients/cpp/client/error.h"
#include "clients/cpp/client/npy.h"
#include "clients/cpp/command/answer_text.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

constexpr std::array kFields = {
    Field{"precision", "NAME", "auto, double or exact: auto when left out"},
    Field{"fields", "NAMES",
          "distance, point, triangle, u, v or normal of a closest point, comma-separated: "
          "distance,point,triangle,u,v when left out"},
    Field{"dtype", "NAME", "f4 or f8: the answer's numbers; those of the points when left out"},
    Field{"deadline_ms", "MS", "Give up after that time: 30000 when left out"},
};

struct Options {
  std::string tree;
  std::string points;
  std::string output;
  bool signed_distance = false;
  bool inside = false;
  std::array<std::string, kFields.size()> values;
};

// Checks the file before it is sent, so an error names the file.
std::string DescribePoints(const LocalFile& points) {
  std::string head(std::min<std::uint64_t>(points.size(), 4096), '\0');
  points.Read(0, head);
  if (!head.starts_with(kNpyMagic)) {
    const std::size_t first = head.find_first_not_of(" \t\r\n");
    if (first != std::string::npos && head[first] == '{') return "points";
    throw LocalFileError(points.path() + R"(: neither a .npy array nor JSON {"points": [[…],…]})");
  }
  NpyHeader header;
  try {
    header = ParseNpyHeader(head);
  } catch (const LocalFileError& error) {
    throw LocalFileError(points.path() + ": " + error.what());
  }
  const std::uint64_t columns = header.shape.empty() ? 0 : header.shape.back();
  if ((header.descr != "<f4" && header.descr != "<f8") || columns != 3) {
    throw LocalFileError(points.path() + ": points are <f4 or <f8 with 3 columns; this is " +
                         header.descr + " with " + std::to_string(columns));
  }
  return CountText(header.ElementCount() / columns) + " points";
}

void QueryPoints(const Options& options, Session& session) {
  if (options.signed_distance && options.inside) {
    throw UsageError("--signed-distance and --inside are two queries; give one of them");
  }
  const bool is_json = options.output.ends_with(".json");
  const LocalFile points(options.points);
  const std::string what = DescribePoints(points);
  Parameters parameters;
  for (std::size_t i = 0; i < kFields.size(); ++i) {
    if (!options.values[i].empty()) parameters.emplace_back(kFields[i].name, options.values[i]);
  }

  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  const char* query = options.inside            ? "inside"
                      : options.signed_distance ? "signed-distance"
                                                : "closest";
  const Answer answer = client.QueryPoints(id, query, parameters, points,
                                           is_json ? "application/json" : "application/x-npy");
  file.Write(answer.body);
  file.Commit();
  session.Say(options.output + ": " + what + ", " + AnswerText(answer.response));
}

}  // namespace

Subcommand PointsCommand(Session& session) {
  auto options = std::make_shared<Options>();
  Subcommand command = {.name = "points",
                        .help = "Closest points of a mesh for a batch of points; rows are x y z",
                        .options = {{.name = "tree",
                                     .help = "Tree, or a mesh file to upload first",
                                     .value = &options->tree,
                                     .type = "ID|FILE",
                                     .required = true},
                                    {.name = "points",
                                     .help = "Points: .npy of shape (…,3), or JSON",
                                     .value = &options->points,
                                     .type = "POINTS",
                                     .required = true},
                                    {.name = "-o,--output",
                                     .help = "Answers to write: .npy, .json, or - (.npy)",
                                     .value = &options->output,
                                     .type = "FILE",
                                     .required = true},
                                    {.name = "--signed-distance",
                                     .help = "Only the distance, negative inside",
                                     .value = &options->signed_distance},
                                    {.name = "--inside",
                                     .help = "Only whether each point is inside",
                                     .value = &options->inside}},
                        .run = [options, &session] { QueryPoints(*options, session); }};
  for (std::size_t i = 0; i < kFields.size(); ++i) {
    command.options.push_back(FieldOption(kFields[i], &options->values[i]));
  }
  return command;
}

}  // namespace kdray::client
