// SPDX-License-Identifier: Apache-2.0
// The adaptor: HTTP/1.1 over TCP, by cpp-httplib 0.11 or 0.18. Its .cc is the only file that
// includes the library, whose defaults are unsafe with hostile clients; it documents what the
// library does and what it does not.
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
  /// How long Drain() lets idle connections wait for a request that may be on its way.
  std::chrono::milliseconds drain_grace{1000};
  PaceLimit body_pace;
  PaceLimit answer_pace;
};

/// Serves from Start() to Stop(). An exception of a handler affects only its own request (500
/// `internal`, without the text).
class HttpServer {
 public:
  /// `handler` must outlive the server.
  HttpServer(HttpServerOptions options, HttpHandler& handler);
  ~HttpServer();

  /// Binds the port exclusively: a second server on it fails here. Returns the cause of a failure,
  /// for people.
  std::optional<std::string> Bind();
  /// After Bind().
  int port() const;
  /// Starts accepting in a separate thread, until Stop(), whatever accept() reports.
  void Start();
  /// Every connection ends with its next answer, which says so, or when it was idle for
  /// `drain_grace`. New ones still get one request each.
  void Drain();
  /// After Drain(): true when no connection is left, false at the deadline. Before it returns true,
  /// it stops accepting, and answers the connections that were in the queue.
  bool WaitUntilIdle(std::chrono::steady_clock::time_point deadline);
  /// Cancels all work, and gives its answers a moment to leave.
  void CancelWork();
  /// Stops accepting, closes every connection and waits for its handler.
  void Stop();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kdray::server
