// SPDX-License-Identifier: Apache-2.0
// rays, points and visibility: batches from files or standard input.
#include <array>
#include <memory>

#include "clients/cpp/command/batch.h"
#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/ending.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

constexpr Field kDeadline = {"deadline_ms", "MS", "Give up after that time: 30000 when left out"};
constexpr Field kCull = {"cull", "NAME",
                         "none, back or front: sides that are no hits; none when left out",
                         "none,back,front"};

constexpr std::array kRayFields = {
    Field{"precision", "NAME", kPrecisionHelp, kPrecisionValues},
    Field{"fields", "NAMES",
          "t, triangle, u, v, normal, point, side, group, uv or shading_normal of a hit, "
          "comma-separated: t,triangle,u,v when left out",
          "t,triangle,u,v,normal,point,side,group,uv,shading_normal"},
    Field{"max_hits", "N", "Hits of a ray with --all, at most, the nearest: 64 when left out"},
    Field{"t_min", "T",
          "Nearest t that counts, or auto for rays that begin on the mesh: 0 when left out"},
    Field{"t_max", "T", "Farthest t that counts, or auto for segments that end on the mesh"},
    kCull,
    Field{"dtype", "NAME", "f4 or f8: the answer's numbers; those of the rays when left out",
          "f4,f8"},
    kDeadline,
};

constexpr std::array kPointFields = {
    Field{"precision", "NAME", "auto, double or exact: auto when left out", "auto,double,exact"},
    Field{"fields", "NAMES",
          "distance, point, triangle, u, v or normal of a closest point, comma-separated: "
          "distance,point,triangle,u,v when left out",
          "distance,point,triangle,u,v,normal"},
    Field{"dtype", "NAME", "f4 or f8: the answer's numbers; those of the points when left out",
          "f4,f8"},
    kDeadline,
};

constexpr std::array kVisibilityFields = {
    Field{"precision", "NAME", kPrecisionHelp, kPrecisionValues},
    Field{"t_min", "T",
          "Where the tested part of a segment begins, 0 to 1: auto, off the mesh, when left out"},
    Field{"t_max", "T", "Where it ends: auto when left out"},
    kCull,
    kDeadline,
};

struct Options {
  std::string tree;
  std::string rows;
  std::string second_rows;  // visibility: the second set
  std::string output;
  bool any = false, count = false, all = false;       // rays
  bool signed_distance = false, inside = false;       // points
  bool to_directions = false, bits = false;           // visibility
  std::array<std::string, kRayFields.size()> values;  // the longest of the three
};

// Where a command writes, and as what: decided before anything is sent.
struct Target {
  Target(const Options& options, Session& session)
      : is_json(TypeOfOutput(options.output, {"npy", "json"}) == "json" ||
                (options.output == "-" && session.json())),
        file(options.output, session.console()) {}

  bool is_json;
  OutputFile file;
};

ProgressBar BarFor(Session& session, const char* label, const Rows& rows, const char* noun,
                   bool is_json) {
  if (is_json || !IsSplit(rows)) {
    return session.Bar(label, static_cast<double>(rows.bytes.size()), ProgressUnit::Bytes());
  }
  return session.Bar(label, static_cast<double>(rows.count), {.name = noun});
}

void Report(const Options& options, Session& session, const std::string& id, const char* noun,
            const Rows& rows, const AnswerFacts& facts) {
  if (options.output == "-" && session.json()) return;  // the answers are what --json prints
  std::vector<std::pair<std::string, Document>> members = {{"file", Document(options.output)},
                                                           {"tree", Document(id)}};
  if (rows.header) members.emplace_back(noun, Document(rows.count));
  for (auto& member : facts.Members()) members.push_back(std::move(member));
  const std::string count = RowsText(rows, noun), text = facts.Text();
  const char* const separator = count.empty() || text.empty() ? "" : ", ";
  session.Report(members, options.output + ": " + count + separator + text);
}

void Run(const Options& options, Session& session, const RowForm& form, const char* label,
         BatchQuery query) {
  const Rows rows = ReadRows(session.Read(options.rows), form);
  Target target(options, session);
  query.wants_json = target.is_json;
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  AnswerFacts facts;
  {
    ProgressBar bar = BarFor(session, label, rows, form.noun, target.is_json);
    facts = RunBatch(client, id, query, rows, target.file, bar);
  }
  target.file.Commit();
  Report(options, session, id, form.noun, rows, facts);
}

void QueryRays(const Options& options, Session& session) {
  if (options.any + options.count + options.all > 1) {
    throw UsageError("--any, --count and --all exclude each other");
  }
  const char* const query = options.any     ? "rays/any"
                            : options.count ? "rays/count"
                            : options.all   ? "rays/all"
                                            : "rays/closest";
  Run(options, session, {.noun = "rays", .columns = {6, 8}}, "casting",
      {.path = query,
       .options = ParametersOf(kRayFields, options.values),
       .numbers_rows = options.all});
}

void QueryPoints(const Options& options, Session& session) {
  if (options.signed_distance && options.inside) {
    throw UsageError("--signed-distance and --inside are two queries; give one of them");
  }
  const char* const query = options.inside            ? "points/inside"
                            : options.signed_distance ? "points/signed-distance"
                                                      : "points/closest";
  Run(options, session, {.noun = "points", .columns = {3}}, "measuring",
      {.path = query, .options = ParametersOf(kPointFields, options.values)});
}

void QueryVisibility(const Options& options, Session& session) {
  Parameters parameters = ParametersOf(kVisibilityFields, options.values);
  if (options.to_directions) parameters.emplace_back("to_directions", "true");
  if (options.bits) parameters.emplace_back("bits", "true");
  const RowForm form = {.noun = "points", .columns = {3}};
  const Rows from = ReadRows(session.Read(options.rows), form);
  if (!from.header) {
    throw LocalFileError(from.bytes.name() + ": points of visibility are .npy arrays");
  }
  const Rows to = ReadRows(session.Read(options.second_rows), form);
  if (!to.header || to.header->descr != from.header->descr || !to.CanBeSplit() ||
      !from.CanBeSplit()) {
    throw LocalFileError(to.bytes.name() + ": both sets must be .npy arrays in C order with the " +
                         "same type of numbers; " + from.bytes.name() + " has " +
                         from.header->descr);
  }
  session.RefuseJsonBeside(options.output);
  TypeOfOutput(options.output, {"npy"});
  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  const std::string id = session.TreeIdFor(client, options.tree);
  AnswerFacts facts;
  {
    ProgressBar bar = session.Bar("looking", static_cast<double>(from.count), {.name = "points"});
    facts = RunVisibility(client, id, parameters, from, to, file, bar);
  }
  file.Commit();
  Report(options, session, id, "points", from, facts);
}

Option OutputOption(std::string* value, const char* what) {
  return {.name = "-o,--output",
          .help = std::string(what) + " to write: .npy, .json, or - for standard output (.npy)",
          .value = value,
          .type = "FILE",
          .required = true};
}

}  // namespace

Subcommand RaysCommand(Session& session) {
  auto options = std::make_shared<Options>();
  Subcommand command = {
      .name = "rays",
      .help = "Closest hits of a batch of rays; rows are ox oy oz dx dy dz, or with t_min t_max",
      .options = {TreeOption(&options->tree),
                  {.name = "rays",
                   .help = "Rays: .npy of shape (…,6) or (…,8), or JSON; - for standard input",
                   .value = &options->rows,
                   .type = "RAYS",
                   .required = true},
                  OutputOption(&options->output, "Hits"),
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
  AddFieldOptions(&command, kRayFields, options->values);
  return command;
}

Subcommand PointsCommand(Session& session) {
  auto options = std::make_shared<Options>();
  Subcommand command = {
      .name = "points",
      .help = "Closest points of a mesh for a batch of points; rows are x y z",
      .options = {TreeOption(&options->tree),
                  {.name = "points",
                   .help = "Points: .npy of shape (…,3), or JSON; - for standard input",
                   .value = &options->rows,
                   .type = "POINTS",
                   .required = true},
                  OutputOption(&options->output, "Answers"),
                  {.name = "--signed-distance",
                   .help = "Only the distance, negative inside",
                   .value = &options->signed_distance},
                  {.name = "--inside",
                   .help = "Only whether each point is inside",
                   .value = &options->inside}},
      .run = [options, &session] { QueryPoints(*options, session); }};
  AddFieldOptions(&command, kPointFields, options->values);
  return command;
}

Subcommand VisibilityCommand(Session& session) {
  auto options = std::make_shared<Options>();
  Subcommand command = {
      .name = "visibility",
      .help = "Which points of two sets see each other; rows are x y z",
      .options = {TreeOption(&options->tree),
                  {.name = "from",
                   .help = "First set: .npy of shape (…,3); - for standard input",
                   .value = &options->rows,
                   .type = "POINTS",
                   .required = true},
                  {.name = "to",
                   .help = "Second set, as the first",
                   .value = &options->second_rows,
                   .type = "POINTS",
                   .required = true},
                  {.name = "-o,--output",
                   .help = "A row for each point of the first set: .npy, or - for standard output",
                   .value = &options->output,
                   .type = "FILE",
                   .required = true},
                  {.name = "--to-directions",
                   .help = "The second set are directions, and the rays have no end",
                   .value = &options->to_directions},
                  {.name = "--bits",
                   .help = "Eight pairs in a byte, in the order of numpy.packbits",
                   .value = &options->bits}},
      .run = [options, &session] { QueryVisibility(*options, session); }};
  AddFieldOptions(&command, kVisibilityFields, options->values);
  return command;
}

}  // namespace kdray::client
