// The adaptor: HTTP/1.1 over TCP, by cpp-httplib 0.11 or 0.18. Its .cc is the only file that
// includes the library, whose defaults are not fit for hostile clients; what is taken from it and
// what is done beside it stands there.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include "server/http/connection.h"
#include "server/http/message.h"
#include "server/http/request_head.h"

namespace kdray::server {

struct HttpServerOptions {
  std::string host = "127.0.0.1";
  int port = 8080;  ///< 0 picks a free one
  std::size_t max_connections = 1024;
  HeadLimits head;
  std::chrono::milliseconds head_timeout{
      5000};  ///< from the first byte of a request to the end of its head
  std::chrono::milliseconds idle_timeout{15000};  ///< between two requests of a connection
  PaceLimit body_pace;
  PaceLimit answer_pace;
};

/// Serves from Start() to Stop(). A handler that throws costs its own request only (500 `internal`,
/// without the text).
class HttpServer {
 public:
  /// `handler` must outlive the server.
  HttpServer(HttpServerOptions options, HttpHandler& handler);
  ~HttpServer();

  /// Takes the port, alone: a second server on it fails here. Returns why it could not, for people.
  std::optional<std::string> Bind();
  /// After Bind().
  int port() const;
  /// Begins to accept, in a thread of its own. Whatever accept() reports, it goes on until Stop().
  void Start();
  /// Idle connections are closed, others after the answer under way; new ones are still served, one
  /// request each.
  void Drain();
  /// After Drain(): true once no request is under way, false at the deadline.
  bool WaitUntilIdle(std::chrono::steady_clock::time_point deadline);
  /// Accepts no more, cuts every connection and waits for its handler.
  void Stop();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kdray::server
