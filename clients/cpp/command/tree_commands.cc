// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <ostream>

#include "clients/cpp/command/description.h"
#include "clients/cpp/command/ending.h"
#include "clients/cpp/command/mesh_files.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"
#include "kdray/error.h"
#include "kdray/find_tree.h"

namespace kdray::client {
namespace {

struct Options {
  std::vector<std::string> trees;
  std::string output;
  int depth = 0;
  bool full = false;
};

void List(const Options& options, Session& session) {
  Client client = session.Connect();
  std::vector<Document> descriptions;
  std::vector<std::vector<std::string>> rows = {ListHeader()};
  std::string after;
  do {
    TreePage page = client.ListTrees(after);
    for (Tree& tree : page.trees) {
      rows.push_back(ListRowOf(tree, options.full));
      if (session.json()) descriptions.push_back(std::move(tree.description));
    }
    after = page.next.value_or("");
  } while (!after.empty());
  std::ostream& out = session.console().out;
  if (session.json()) {
    session.PrintJson(Document::ArrayOf(descriptions));
  } else {
    out << Printable(FittedTable(rows, "lrlllrl", session.console().out_columns, 1));
  }
  if (rows.size() == 1) session.Say("no trees yet; kdray upload FILE makes one");
}

void Show(const Options& options, Session& session) {
  Client client = session.Connect();
  const Tree tree = client.GetTree(session.StoredTreeIdFor(client, options.trees.front()));
  if (session.json()) return session.PrintJson(tree.description);
  session.console().out << Printable(DetailsOf(tree.description));
}

void Delete(const Options& options, Session& session) {
  Client client = session.Connect();
  std::vector<Document> deleted;
  for (const std::string& text : options.trees) {
    const std::string id = ResolveTreeId(client, text);
    client.DeleteTree(id);
    session.Say("deleted " + id);
    deleted.push_back(Document(id));
  }
  if (session.json()) session.PrintJson(Document::ArrayOf(deleted));
}

void Cells(const Options& options, Session& session) {
  Client client = session.Connect();
  const std::string id = session.StoredTreeIdFor(client, options.trees.front());
  const Document answer = client.Cells(id, options.depth);
  std::ostream& out = session.console().out;
  if (session.json()) return session.PrintJson(answer);
  std::vector<std::vector<std::string>> rows = {{"DEPTH", "KIND", "TRIANGLES", "MIN", "MAX"}};
  for (const Document& cell : answer["cells"].Items())
    rows.push_back({std::to_string(cell["depth"].Count().value_or(0)),
                    cell["leaf"].Flag() == true ? "leaf" : "node",
                    CountText(cell["triangles"].Count().value_or(0)),
                    VectorText(cell["min"].Numbers()), VectorText(cell["max"].Numbers())});
  out << FittedTable(rows, "rlrll", session.console().out_columns, 2);
}

void Mesh(const Options& options, Session& session) {
  session.RefuseJsonBeside(options.output);
  TypeOfOutput(options.output, kMeshEndings);
  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  const Tree tree = client.GetTree(session.StoredTreeIdFor(client, options.trees.front()));
  const Document mesh = tree.description["mesh"];
  // A file with the wrong ending would mislead whoever opens it.
  const std::string format = mesh["format"].Text().value_or("");
  if (!format.empty()) TypeOfOutput(options.output, {format});
  std::uint64_t bytes = 0;
  {
    ProgressBar receiving =
        session.Bar("receiving", mesh["bytes"].Number().value_or(0), ProgressUnit::Bytes());
    client.DownloadMesh(tree.id, [&](std::string_view piece) {
      file.Write(piece);
      bytes += piece.size();
      receiving.Update(static_cast<double>(bytes));
    });
  }
  file.Commit();
  session.Report({{"file", Document(options.output)},
                  {"tree", Document(tree.id)},
                  {"format", Document(format)},
                  {"bytes", Document(bytes)}},
                 options.output + ": " + ByteText(static_cast<double>(bytes)));
}

}  // namespace

std::vector<Subcommand> TreeCommands(Session& session) {
  const auto new_options = [] { return std::make_shared<Options>(); };
  const auto tree = [](const auto& options) {
    return Option{.name = "tree",
                  .help = "Tree: an id or its beginning, or a mesh that was uploaded",
                  .value = &options->trees,
                  .type = "ID|FILE",
                  .required = true,
                  .count = 1};
  };
  const auto trees = [&](const auto& options) {
    Option any_number = tree(options);
    any_number.help = "Tree, whole id or its beginning";
    any_number.type = "ID";
    any_number.count.reset();
    return any_number;
  };
  const auto run = [&](void (*function)(const Options&, Session&), const auto& options) {
    return [function, options, &session] { function(*options, session); };
  };

  std::vector<Subcommand> commands;
  auto options = new_options();
  commands.push_back({.name = "list",
                      .help = "Trees that the server has, newest first",
                      .options = {{.name = "--full", .help = "Whole ids", .value = &options->full}},
                      .run = run(List, options)});

  options = new_options();
  commands.push_back({.name = "show",
                      .help = "Describe a tree and its mesh",
                      .options = {tree(options)},
                      .run = run(Show, options)});

  options = new_options();
  commands.push_back({.name = "delete",
                      .help = "Delete trees; a mesh is deleted with its last tree",
                      .options = {trees(options)},
                      .run = run(Delete, options)});

  options = new_options();
  commands.push_back({.name = "cells",
                      .help = "Boxes of a tree's nodes at one depth, and of the leaves above",
                      .options = {tree(options),
                                  {.name = "--depth",
                                   .help = "0 is the root",
                                   .value = &options->depth,
                                   .type = "DEPTH",
                                   .required = true}},
                      .run = run(Cells, options)});

  options = new_options();
  commands.push_back({.name = "mesh",
                      .help = "The file that was uploaded",
                      .options = {tree(options),
                                  {.name = "-o,--output",
                                   .help = "File to write, with the ending of the mesh's format, "
                                           "or - for standard output",
                                   .value = &options->output,
                                   .type = "FILE",
                                   .required = true}},
                      .run = run(Mesh, options)});
  return commands;
}

}  // namespace kdray::client
