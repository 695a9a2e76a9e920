// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/session.h"

#include <cstdlib>
#include <filesystem>
#include <ostream>

#include "clients/cpp/command/description.h"
#include "clients/cpp/command/progress_bar.h"
#include "kdray/error.h"
#include "kdray/find_tree.h"
#include "kdray/trace_context.h"

namespace kdray::client {
namespace {

/// Whether an argument `ID|FILE` is a file, or standard input.
bool IsFile(const std::string& text) {
  std::error_code ignored;
  return text == "-" || std::filesystem::exists(text, ignored);
}

/// The text of an argument `ID|FILE` that is no file. UsageError if it does not look like an id.
const std::string& CheckedId(const std::string& text) {
  if (LooksLikeTreeId(text)) return text;
  throw UsageError("'" + text + "' is neither a file here nor a tree id");
}

}  // namespace

void RefuseSecondDash() {
  throw UsageError("'-' is given twice; standard input can be read only once");
}

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
           .environment = "KDRAY_TOKEN",
           .may_be_empty = true},
          {.name = "--traceparent",
           .help = "Trace of these requests (W3C Trace Context), which the servers log",
           .value = &traceparent_,
           .type = "TEXT",
           .last_wins = true,
           .environment = "TRACEPARENT",
           .may_be_empty = true},
          {.name = "--timeout",
           .help = "Longest silence of the server to wait for, in seconds",
           .value = &timeout_s_,
           .type = "S",
           .help_tells_default = true,
           .range = Option::Range{1, 86400}},
          {.name = "--json",
           .help = "Print results as JSON on standard output, also of commands that write files",
           .value = &json_},
          {.name = "-q,--quiet",
           .help = "No progress and no remarks, only results and errors",
           .value = &quiet_}};
}

std::string Session::Traceparent() const {
  if (traceparent_.empty() || IsTraceparent(traceparent_)) return traceparent_;
  // Other programs set the variable. An invalid one begins no trace, and is no error.
  const char* const variable = std::getenv("TRACEPARENT");
  if (variable != nullptr && variable == traceparent_) return {};
  throw UsageError("the traceparent '" + traceparent_ +
                   "' is invalid; it has the form 00-TRACE-SPAN-FLAGS with 32, 16 and 2 lower-case "
                   "hexadecimal digits");
}

Client Session::Connect() const {
  // A line break in the token would end the header and begin another.
  if (token_.find_first_of("\r\n") != std::string::npos)
    throw UsageError("the token contains a line break");
  return Client({.server = ParseServerUrl(server_),
                 .token = token_,
                 .traceparent = Traceparent(),
                 .timeout_s = timeout_s_});
}

Payload Session::Read(const std::string& path) {
  if (path != "-") return Payload::OfFile(path);
  if (stdin_is_taken_) RefuseSecondDash();
  stdin_is_taken_ = true;
  ProgressBar reading = Bar("reading standard input", 0, ProgressUnit::Bytes());
  return Payload::OfStandardInput(
      [&](std::uint64_t done) { reading.Update(static_cast<double>(done)); });
}

UploadResult Session::Upload(Client& client, const Payload& mesh, const std::string& build) {
  const auto size = static_cast<double>(mesh.size());
  ProgressBar hashing = Bar("hashing  ", size, ProgressUnit::Bytes());
  ProgressBar sending = Bar("uploading", size, ProgressUnit::Bytes());
  ProgressBar building = Bar("building ", 1, {});
  const UploadWatcher watcher = {
      .on_hashed = [&](std::uint64_t done) { hashing.Update(static_cast<double>(done)); },
      .on_sent =
          [&](std::uint64_t sent) {
            hashing.Finish();
            sending.Update(static_cast<double>(sent));
          },
      .on_build =
          [&](double progress) {
            hashing.Finish();
            sending.Finish();
            building.Update(progress);
          }};
  UploadResult result = UploadMesh(client, mesh, build, watcher);
  for (ProgressBar* bar : {&hashing, &sending, &building}) bar->Finish();
  if (!result.was_ready) Say(SummaryOf(result.tree.description));
  return result;
}

std::string Session::TreeIdFor(Client& client, const std::string& id_or_file) {
  if (IsFile(id_or_file)) return Upload(client, Read(id_or_file), "auto").tree.id;
  return ResolveTreeId(client, CheckedId(id_or_file));
}

std::string Session::StoredTreeIdFor(Client& client, const std::string& id_or_file) {
  if (!IsFile(id_or_file)) return ResolveTreeId(client, CheckedId(id_or_file));
  const Payload mesh = Read(id_or_file);
  ProgressBar hashing = Bar("hashing", static_cast<double>(mesh.size()), ProgressUnit::Bytes());
  const std::string sha256 =
      mesh.Sha256([&](std::uint64_t done) { hashing.Update(static_cast<double>(done)); });
  hashing.Finish();
  return ResolveTreeId(client, sha256);
}

void Session::Say(const std::string& line) {
  if (!quiet_) console_.err << Printable(line) << std::endl;
}

void Session::PrintJson(const Document& document) { console_.out << document.Indented() << "\n"; }

void Session::Report(const std::vector<std::pair<std::string, Document>>& facts,
                     const std::string& line) {
  if (json_) {
    PrintJson(Document::ObjectOf(facts));
  } else {
    Say(line);
  }
}

void Session::RefuseJsonBeside(const std::string& output) const {
  if (json_ && output == "-") {
    throw UsageError("-o - and --json both write to standard output; name a file with -o");
  }
}

ProgressBar Session::Bar(const std::string& label, double total, ProgressUnit unit) {
  return ProgressBar(console_, label, total, std::move(unit), quiet_);
}

}  // namespace kdray::client
