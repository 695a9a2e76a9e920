// One HTTP exchange after the other with one server. The only file pair that knows cpp-httplib.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "clients/cpp/client/local_file.h"
#include "clients/cpp/client/server_url.h"

namespace kdray::client {

struct ClientOptions {
  ServerUrl server;
  std::string token = {};  ///< sent as `Authorization: Bearer` when not empty
  int connect_timeout_s = 10;
  /// Longest silence of the server while an answer is awaited. Above its largest deadline_ms.
  int timeout_s = 660;
};

/// Called while a body is sent, with the bytes sent so far.
using SendProgress = std::function<void(std::uint64_t sent)>;

/// Takes a successful answer's body piece by piece. May throw; the exchange is then given up.
using BodySink = std::function<void(std::string_view piece)>;

struct HttpRequest {
  std::string method = "GET";
  std::string path;  ///< below the server's prefix, percent-encoded: "/v1/trees"
  Parameters query = {};
  std::string accept = {};        ///< Accept header; empty sends none
  std::string content_type = {};  ///< of the body
  std::string body = {};
  const LocalFile* file = nullptr;  ///< sent instead of `body`, without reading it into memory
  SendProgress on_sent = {};        ///< for `file`
  BodySink sink = {};               ///< for GET: takes the body of an answer with status 200
};

struct HttpResponse {
  int status = 0;
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;                            ///< empty where a sink took it

  /// The header's value, or "".
  std::string Header(const std::string& lower_case_name) const;
};

/// Keeps one connection open between exchanges. Not safe from several threads.
class Transport {
 public:
  explicit Transport(ClientOptions options);
  ~Transport();

  /// Any status is an answer. Throws ConnectionError when none came, LocalFileError when
  /// request.file could not be read, and what the sink throws.
  HttpResponse Send(const HttpRequest& request);

  const ClientOptions& options() const { return options_; }

 private:
  struct Connection;

  ClientOptions options_;
  std::unique_ptr<Connection> connection_;
};

}  // namespace kdray::client
