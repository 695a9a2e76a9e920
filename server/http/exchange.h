// SPDX-License-Identifier: Apache-2.0
// One request and its answer on a connection, for the handler; converts exceptions to answers.
// Independent of the library that listens and writes (http_server.cc).
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "server/http/connection.h"
#include "server/http/departure_watch.h"
#include "server/http/message.h"
#include "server/http/request_head.h"

namespace kdray::server {

/// Call Accept() or Refuse(), then Answer(), on the connection's thread. Neither copied nor moved,
/// because the request points to it. Its arguments must outlive it.
class Exchange final : public HttpPeer, private WatchedClient {
 public:
  Exchange(Connection& connection, DepartureWatch& watch, const PaceLimit& body_pace,
           std::string remote_addr);
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  /// The request is valid, and its body may be read.
  void Accept(RequestHead head);
  /// The request is invalid; the handler answers with the problem.
  void Refuse(RefusedHead refused);
  /// See HttpRequest.
  void set_came_before_drain(bool came) { request_.came_before_drain = came; }

  /// Calls the handler; an exception becomes an answer without its text. If the client has left
  /// meanwhile, the answer is empty, with status kClientGone.
  void Answer(HttpHandler& handler);

  /// What is known of the request.
  const HttpRequest& request() const { return request_; }
  HttpResponse& response() { return response_; }
  /// The answer's Connection header; empty for HTTP/1.1's default, which keeps the connection.
  std::string_view connection_option() const {
    if (response_.close) return "close";
    return is_1_0_ ? "keep-alive" : "";
  }

  /// After the answer was sent: reads what the request that was refused still sends, so the
  /// connection can be kept. False if that fails.
  bool SkipBody();

  /// Whether the whole answer was sent; for the record.
  void set_complete(bool complete) { complete_ = complete; }
  HttpRecord Record(std::chrono::steady_clock::time_point start) const;

  // HttpPeer
  std::optional<std::uint64_t> body_size() const override { return body_size_; }
  api::Outcome<std::size_t> ReadBody(std::span<std::byte> out) override;
  std::shared_ptr<void> CancelWhenGone(const core::CancelToken& token) override;

 private:
  // WatchedClient
  bool Probe() override;
  void Left() override { gone_ = true; }

  std::string Received() const;
  void SetRequest(RequestHead head);

  Connection& connection_;
  DepartureWatch& watch_;
  const PaceLimit body_pace_;
  HttpRequest request_;
  std::optional<api::Problem> refusal_;
  HttpResponse response_;
  std::optional<std::uint64_t> body_size_ = 0;
  std::atomic<bool> gone_{false};  ///< the client has left
  bool expects_continue_ = false, keep_alive_ = false, is_1_0_ = false, complete_ = false;
};

}  // namespace kdray::server
