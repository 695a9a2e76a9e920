#include <ostream>

#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/subcommands.h"

namespace kdray::client {

void AddUpload(CLI::App& app, Session& session) {
  struct Options {
    std::string file;
    std::string build = "auto";
    bool json = false;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "upload", "Send a mesh and wait until its tree is built; prints the tree's id");
  command->add_option("file", options->file, "Mesh: OBJ, PLY, STL, OFF")
      ->required()
      ->type_name("FILE");
  command->add_option("--build", options->build, kBuildHelp)->type_name("NAME");
  command->add_flag("--json", options->json, "Print the tree's whole description");
  command->callback([options, &session] {
    Client client = session.Connect();
    const UploadResult result = session.Upload(client, options->file, options->build);
    if (result.was_ready)
      session.Say("the server already has this tree");
    else if (!result.was_sent)
      session.Say("the server already had this mesh; nothing was sent");
    session.console().out << (options->json ? result.tree.description.dump(2) : result.tree.id)
                          << "\n";
  });
}

}  // namespace kdray::client
