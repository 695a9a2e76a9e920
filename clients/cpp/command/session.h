// SPDX-License-Identifier: Apache-2.0
// Common to all subcommands: the server, the token, and the output of remarks.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "clients/cpp/command/command.h"
#include "clients/cpp/command/progress_bar.h"
#include "clients/cpp/command/subcommands.h"
#include "kdray/client.h"
#include "kdray/upload.h"

namespace kdray::client {

/// A failure that is printed already; the program ends with this code.
struct Reported : std::runtime_error {
  explicit Reported(ExitCode exit_code) : std::runtime_error("reported"), code(exit_code) {}

  ExitCode code;
};

/// Throws UsageError.
[[noreturn]] void RefuseSecondDash();

class Session {
 public:
  explicit Session(Console console) : console_(console) {}

  /// --server, --token, --traceparent, --timeout, --json, --quiet. Their values go to this object.
  std::vector<Option> Options();

  /// A client for the chosen server. Throws UsageError if its address is invalid.
  Client Connect() const;

  /// The bytes of a file, or of standard input for `-`. Throws UsageError for a second `-`.
  Payload Read(const std::string& path);

  /// Uploads with progress on standard error, and prints one line about a new tree.
  UploadResult Upload(Client& client, const Payload& mesh, const std::string& build);

  /// The tree that an argument `ID|FILE` names. An existing file, and the mesh on standard input
  /// for
  /// `-`, is uploaded first (build `auto`); any other text is an id or the beginning of one.
  std::string TreeIdFor(Client& client, const std::string& id_or_file);

  /// The same for commands that ask about a tree and make none: a file is only hashed, and names
  /// the tree that the server has of it.
  std::string StoredTreeIdFor(Client& client, const std::string& id_or_file);

  bool quiet() const { return quiet_; }
  bool json() const { return json_; }

  /// Prints a line for people, unless --quiet is set.
  void Say(const std::string& line);

  /// Prints a JSON document on standard output.
  void PrintJson(const Document& document);

  /// Says what was done: with --json as a document on standard output, else as a line for people.
  void Report(const std::vector<std::pair<std::string, Document>>& facts, const std::string& line);

  /// Throws UsageError if both the result and the report of --json would go to standard output.
  void RefuseJsonBeside(const std::string& output) const;

  /// A bar on standard error.
  ProgressBar Bar(const std::string& label, double total, ProgressUnit unit);

  Console& console() { return console_; }

 private:
  /// --traceparent, or "". Throws UsageError if it is invalid.
  std::string Traceparent() const;

  Console console_;
  std::string server_ = "http://127.0.0.1:8080";
  std::string token_, traceparent_;
  int timeout_s_ = ClientOptions{}.timeout_s;
  bool quiet_ = false;
  bool json_ = false;
  bool stdin_is_taken_ = false;
};

}  // namespace kdray::client
