#include <memory>
#include <ostream>

#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"

namespace kdray::client {

Subcommand UploadCommand(Session& session) {
  struct Options {
    std::string file;
    std::string build = "auto";
    bool json = false;
  };
  auto options = std::make_shared<Options>();
  return {
      .name = "upload",
      .help = "Send a mesh and wait until its tree is built; prints the tree's id",
      .options = {{.name = "file",
                   .help = "Mesh: OBJ, PLY, STL, OFF, GLB, glTF",
                   .value = &options->file,
                   .type = "FILE",
                   .required = true},
                  {.name = "--build", .help = kBuildHelp, .value = &options->build, .type = "NAME"},
                  {.name = "--json",
                   .help = "Print the tree's whole description",
                   .value = &options->json}},
      .run = [options, &session] {
        Client client = session.Connect();
        const UploadResult result = session.Upload(client, options->file, options->build);
        if (result.was_ready)
          session.Say("the server already has this tree");
        else if (!result.was_sent)
          session.Say("the server already had this mesh; nothing was sent");
        const Tree& tree = result.tree;
        session.console().out << (options->json ? tree.description.Indented() : tree.id) << "\n";
      }};
}

}  // namespace kdray::client
