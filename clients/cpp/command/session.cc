#include "clients/cpp/command/session.h"

#include <filesystem>
#include <ostream>

#include "clients/cpp/client/error.h"
#include "clients/cpp/client/find_tree.h"
#include "clients/cpp/command/description.h"
#include "clients/cpp/command/progress_bar.h"

namespace kdray::client {

std::vector<Option> Session::Options() {
  return {{.name = "--server",
           .help = "Address of kdrayd",
           .value = &server_,
           .type = "URL",
           .help_tells_default = true,
           .last_wins = true,
           .environment = "KDRAY_SERVER"},
          {.name = "--token",
           .help = "Bearer token, if the server needs one; better in the environment, where other "
                   "users do not see it",
           .value = &token_,
           .type = "TOKEN",
           .last_wins = true,
           .environment = "KDRAY_TOKEN"},
          {.name = "--timeout",
           .help = "Longest silence of the server to wait for, in seconds",
           .value = &timeout_s_,
           .type = "S",
           .help_tells_default = true,
           .range = Option::Range{1, 86400}},
          {.name = "-q,--quiet",
           .help = "No progress and no remarks, only results and errors",
           .value = &quiet_}};
}

Client Session::Connect() const {
  // A line break in the token would end the header and begin another.
  if (token_.find_first_of("\r\n") != std::string::npos)
    throw UsageError("the token contains a line break");
  return Client({.server = ParseServerUrl(server_), .token = token_, .timeout_s = timeout_s_});
}

UploadResult Session::Upload(Client& client, const std::string& path, const std::string& build) {
  const LocalFile mesh(path);
  ProgressBar sending(console_, "uploading", mesh.size(), quiet_);
  ProgressBar building(console_, "building ", 0, quiet_);
  const UploadWatcher watcher = {
      .on_sent =
          [&](std::uint64_t sent) {
            sending.Update(static_cast<double>(sent) / static_cast<double>(mesh.size()));
          },
      .on_build =
          [&](double progress) {
            sending.Finish();
            building.Update(progress);
          }};
  UploadResult result = UploadMesh(client, mesh, build, watcher);
  building.Finish();
  if (!result.was_ready) Say(SummaryOf(result.tree.description));
  return result;
}

std::string Session::TreeIdFor(Client& client, const std::string& id_or_file) {
  std::error_code ignored;
  if (std::filesystem::exists(id_or_file, ignored))
    return Upload(client, id_or_file, "auto").tree.id;
  return ResolveTreeId(client, id_or_file);
}

void Session::Say(const std::string& line) {
  if (!quiet_) console_.err << Printable(line) << std::endl;
}

}  // namespace kdray::client
