// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>

#include "clients/cpp/command/contract_help.h"
#include "clients/cpp/command/mesh_files.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/session.h"
#include "clients/cpp/command/subcommands.h"
#include "clients/cpp/command/text.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

struct Options {
  std::vector<std::string> files;
  std::string build = "auto";
};

Tree UploadOne(Client& client, const std::string& file, const std::string& build,
               Session& session) {
  UploadResult result = session.Upload(client, session.Read(file), build);
  if (result.was_ready) {
    session.Say("the server already has this tree");
  } else if (!result.was_sent) {
    session.Say("the server already had this mesh; nothing was sent");
  }
  return std::move(result.tree);
}

// As sha256sum prints: the id, two blanks, the file. One bad file does not keep the others away;
// the first failure decides the exit code.
void UploadMany(Client& client, const std::vector<std::string>& files, const std::string& build,
                Session& session) {
  std::optional<ExitCode> first_failure;
  std::size_t failures = 0;
  std::vector<Document> documents;
  for (std::size_t i = 0; i < files.size(); ++i) {
    session.Say(files[i] + " (" + CountText(i + 1) + " of " + CountText(files.size()) + ")");
    const auto failed = [&](ExitCode code, const std::string& why) {
      first_failure = first_failure.value_or(code);
      ++failures;
      session.console().err << "kdray: " << Printable(files[i] + ": " + why) << std::endl;
    };
    try {
      const Tree tree = UploadOne(client, files[i], build, session);
      if (session.json()) {
        documents.push_back(
            Document::ObjectOf({{"file", Document(files[i])}, {"tree", tree.description}}));
      } else {
        session.console().out << tree.id << "  " << Printable(files[i]) << std::endl;
        CheckOutput(session.console());
      }
    } catch (const Refusal& error) {
      if (error.problem.status == 401) throw;  // the same for every file
      failed(kExitRefused, error.what());
    } catch (const LocalFileError& error) {
      failed(kExitLocalFile, error.what());
    }
  }
  if (session.json()) session.PrintJson(Document::ArrayOf(documents));
  if (!first_failure) return;
  session.console().out.flush();
  session.Say(CountText(failures) + " of " + CountText(files.size()) + " files failed");
  throw Reported(*first_failure);
}

void Upload(const Options& options, Session& session) {
  if (std::count(options.files.begin(), options.files.end(), "-") > 1) RefuseSecondDash();
  const std::vector<std::string> files = ExpandMeshFiles(options.files);
  Client client = session.Connect();
  std::error_code ignored;
  if (options.files.size() > 1 || files.size() > 1 ||
      std::filesystem::is_directory(options.files.front(), ignored)) {
    return UploadMany(client, files, options.build, session);
  }
  const Tree tree = UploadOne(client, files.front(), options.build, session);
  if (session.json()) {
    session.PrintJson(tree.description);
  } else {
    session.console().out << tree.id << "\n";
  }
}

}  // namespace

Subcommand UploadCommand(Session& session) {
  auto options = std::make_shared<Options>();
  return {
      .name = "upload",
      .help = "Send meshes and wait until their trees are built; prints the trees' ids",
      .options = {{.name = "file",
                   .help = "Mesh: OBJ, PLY, STL, OFF, GLB, glTF. Several, a directory, a quoted "
                           "pattern, or - for standard input",
                   .value = &options->files,
                   .type = "FILE",
                   .required = true},
                  {.name = "--build",
                   .help = kBuildHelp,
                   .value = &options->build,
                   .type = "NAME",
                   .values = SplitAtCommas(kBuildValues)}},
      .run = [options, &session] { Upload(*options, session); }};
}

}  // namespace kdray::client
