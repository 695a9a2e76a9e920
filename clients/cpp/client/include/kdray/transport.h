// SPDX-License-Identifier: Apache-2.0
// HTTP exchanges with one server, one at a time. Only its .cc includes cpp-httplib.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "kdray/payload.h"
#include "kdray/server_url.h"

namespace kdray::client {

struct ClientOptions {
  ServerUrl server;
  std::string token = {};  ///< sent as `Authorization: Bearer` if not empty
  /// The trace that all requests belong to (trace_context.h); empty sends none.
  std::string traceparent = {};
  int connect_timeout_s = 10;
  /// The longest silence of the server before an answer; above its largest deadline_ms.
  int timeout_s = 660;
};

/// Takes a successful answer's body piece by piece. May throw; the exchange is then abandoned.
using BodySink = std::function<void(std::string_view piece)>;

struct HttpRequest {
  std::string method = "GET";
  std::string path;  ///< below the server's prefix, percent-encoded: "/v1/trees"
  Parameters query = {};
  std::string accept = {};          ///< Accept header; empty sends none
  std::string content_type = {};    ///< of the body
  std::string content_digest = {};  ///< Content-Digest header; empty sends none
  std::string body = {};
  const Payload* payload = nullptr;  ///< sent instead of `body`, without reading it into memory
  ByteProgress on_sent = {};         ///< for `payload`
  BodySink sink = {};                ///< for GET: takes the body of an answer with status 200
};

struct HttpResponse {
  int status = 0;
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;                            ///< empty if a sink took it

  /// The header's value, or "".
  std::string Header(const std::string& lower_case_name) const;
};

/// Keeps one connection open between exchanges. Not safe from several threads.
class Transport {
 public:
  explicit Transport(ClientOptions options);
  ~Transport();

  /// Any status is an answer. Throws ConnectionError without an answer, LocalFileError if
  /// request.payload cannot be read, and the sink's exceptions.
  HttpResponse Send(const HttpRequest& request);

  const ClientOptions& options() const { return options_; }

 private:
  struct Connection;

  ClientOptions options_;
  std::unique_ptr<Connection> connection_;
};

}  // namespace kdray::client
