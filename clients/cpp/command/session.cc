#include "clients/cpp/command/session.h"

#include <filesystem>
#include <ostream>

#include "clients/cpp/client/error.h"
#include "clients/cpp/client/find_tree.h"
#include "clients/cpp/command/description.h"
#include "clients/cpp/command/progress_bar.h"

namespace kdray::client {

void Session::AddOptions(CLI::App& app) {
  app.add_option("--server", server_, "Address of kdrayd")
      ->envname("KDRAY_SERVER")
      ->type_name("URL")
      ->take_last()
      ->capture_default_str();
  app.add_option("--token", token_,
                 "Bearer token, if the server needs one; better in the environment, where other "
                 "users do not see it")
      ->envname("KDRAY_TOKEN")
      ->take_last()
      ->type_name("TOKEN");
  app.add_option("--timeout", timeout_s_, "Longest silence of the server to wait for, in seconds")
      ->check(CLI::Range(1, 86400))
      ->type_name("S")
      ->capture_default_str();
  app.add_flag("-q,--quiet", quiet_, "No progress and no remarks, only results and errors");
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
