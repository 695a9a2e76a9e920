// Common to all subcommands: the server, the token, and the output of remarks.
#pragma once

#include <string>
#include <vector>

#include "clients/cpp/client/client.h"
#include "clients/cpp/client/upload.h"
#include "clients/cpp/command/command.h"
#include "clients/cpp/command/subcommands.h"

namespace kdray::client {

class Session {
 public:
  explicit Session(Console console) : console_(console) {}

  /// --server, --token, --timeout, --quiet. Their values go to this object.
  std::vector<Option> Options();

  /// A client for the chosen server. Throws UsageError if its address is invalid.
  Client Connect() const;

  /// Uploads with progress on standard error, and prints one line about a new tree.
  UploadResult Upload(Client& client, const std::string& path, const std::string& build);

  /// The tree that an argument `ID|FILE` names. An existing file is uploaded first (build `auto`);
  /// any other text is an id or the beginning of one.
  std::string TreeIdFor(Client& client, const std::string& id_or_file);

  bool quiet() const { return quiet_; }

  /// Prints a line for people, unless --quiet is set.
  void Say(const std::string& line);

  Console& console() { return console_; }

 private:
  Console console_;
  std::string server_ = "http://127.0.0.1:8080";
  std::string token_;
  int timeout_s_ = ClientOptions{}.timeout_s;
  bool quiet_ = false;
};

}  // namespace kdray::client
