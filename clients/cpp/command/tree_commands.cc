#include <ostream>

#include "clients/cpp/client/error.h"
#include "clients/cpp/client/find_tree.h"
#include "clients/cpp/command/description.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

struct Options {
  std::vector<std::string> trees;
  std::string output;
  int depth = 0;
  bool json = false;
  bool full = false;
};

void List(const Options& options, Session& session) {
  Client client = session.Connect();
  Json descriptions = Json::array();
  std::vector<std::vector<std::string>> rows = {ListHeader()};
  std::string after;
  do {
    TreePage page = client.ListTrees(after);
    for (Tree& tree : page.trees) {
      rows.push_back(ListRowOf(tree, options.full));
      if (options.json) descriptions.push_back(std::move(tree.description));
    }
    after = page.next.value_or("");
  } while (!after.empty());
  std::ostream& out = session.console().out;
  if (options.json)
    out << descriptions.dump(2) << "\n";
  else
    out << Printable(Table(rows, "lrlllrl"));
  if (rows.size() == 1) session.Say("no trees yet; kdray upload FILE makes one");
}

void Show(const Options& options, Session& session) {
  Client client = session.Connect();
  const Tree tree = client.GetTree(ResolveTreeId(client, options.trees.front()));
  session.console().out << (options.json ? tree.description.dump(2) + "\n"
                                         : Printable(DetailsOf(tree.description)));
}

void Delete(const Options& options, Session& session) {
  Client client = session.Connect();
  for (const std::string& text : options.trees) {
    const std::string id = ResolveTreeId(client, text);
    client.DeleteTree(id);
    session.Say("deleted " + id);
  }
}

std::string PointText(const Json& point) {
  std::string text;
  for (const Json& number : point)
    if (number.is_number()) text += (text.empty() ? "" : " ") + NumberText(number.get<double>(), 6);
  return text;
}

void Cells(const Options& options, Session& session) {
  Client client = session.Connect();
  const Json answer = client.Cells(ResolveTreeId(client, options.trees.front()), options.depth);
  std::ostream& out = session.console().out;
  if (options.json) {
    out << answer.dump(2) << "\n";
    return;
  }
  std::vector<std::vector<std::string>> rows = {{"DEPTH", "KIND", "TRIANGLES", "MIN", "MAX"}};
  for (const Json& cell : answer.value("cells", Json::array()))
    rows.push_back(
        {std::to_string(cell.value("depth", 0)), cell.value("leaf", false) ? "leaf" : "node",
         CountText(cell.value("triangles", std::uint64_t{0})),
         PointText(cell.value("min", Json::array())), PointText(cell.value("max", Json::array()))});
  out << Table(rows, "rlrll");
}

void Mesh(const Options& options, Session& session) {
  OutputFile file(options.output, session.console());
  Client client = session.Connect();
  std::uint64_t bytes = 0;
  client.DownloadMesh(ResolveTreeId(client, options.trees.front()), [&](std::string_view piece) {
    file.Write(piece);
    bytes += piece.size();
  });
  file.Commit();
  session.Say(options.output + ": " + ByteText(static_cast<double>(bytes)));
}

}  // namespace

void AddTreeCommands(CLI::App& app, Session& session) {
  const auto add = [&](const char* name, const char* description, auto run, bool takes_tree) {
    auto options = std::make_shared<Options>();
    CLI::App* command = app.add_subcommand(name, description);
    if (takes_tree) {
      CLI::Option* tree =
          command->add_option("tree", options->trees, "Tree, whole id or its beginning")
              ->required()
              ->type_name("ID");
      if (std::string_view(name) != "delete") tree->expected(1);
    }
    command->callback([options, run, &session] { run(*options, session); });
    return std::pair{command, options};
  };

  const auto [list, list_options] =
      add("list", "Trees that the server has, newest first", List, false);
  list->add_flag("--full", list_options->full, "Whole ids");
  list->add_flag("--json", list_options->json, "The trees' whole descriptions");

  const auto [show, show_options] = add("show", "Describe a tree and its mesh", Show, true);
  show->add_flag("--json", show_options->json, "The whole description");

  add("delete", "Delete trees; a mesh is deleted with its last tree", Delete, true);

  const auto [cells, cells_options] =
      add("cells", "Boxes of a tree's nodes at one depth, and of the leaves above", Cells, true);
  cells->add_option("--depth", cells_options->depth, "0 is the root")
      ->required()
      ->type_name("DEPTH");
  cells->add_flag("--json", cells_options->json, "As the server gives them");

  const auto [mesh, mesh_options] = add("mesh", "The file that was uploaded", Mesh, true);
  mesh->add_option("-o,--output", mesh_options->output, "File to write, or -")
      ->required()
      ->type_name("FILE");
}

}  // namespace kdray::client
