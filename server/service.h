// SPDX-License-Identifier: Apache-2.0
// The HTTP service without the adaptor: request id, token, route, handler, and the headers of every
// answer. Handlers return an answer or a problem; problems become problem+json here.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "api/limits.h"
#include "server/admission.h"
#include "server/backend.h"
#include "server/bearer_tokens.h"
#include "server/cors.h"
#include "server/http/message.h"
#include "server/log.h"
#include "server/metrics.h"
#include "server/request_memory.h"
#include "server/routes.h"

namespace kdray::server {

struct ServiceOptions {
  api::Limits limits;
  // Of each size of work (Lane).
  std::size_t max_running = 2;   ///< queries and renders that compute at the same time
  std::size_t short_factor = 1;  ///< times as many if they take milliseconds
  std::size_t max_queued = 128;  ///< queries and renders that wait for a turn
  /// For bodies, rows, pictures and answers of requests; as many again may be borrowed from
  /// `memory_lender`, if there is one (RequestMemory).
  std::uint64_t request_memory_bytes = std::uint64_t{1} << 30;
  core::MemoryBudget* memory_lender = nullptr;
  std::uint64_t memory_limit_bytes = 0;  ///< of the whole daemon, for the metrics
  std::optional<BearerTokens> tokens;    ///< nullopt: no token is needed
  CorsPolicy cors;
  std::span<const Route> routes = Routes();
};

class Service final : public HttpHandler {
 public:
  /// `backend` and `log` must outlive the service.
  Service(ServiceOptions options, Backend& backend, const Log& log);

  HttpResponse Handle(const HttpRequest& request) override;
  HttpResponse Refuse(const HttpRequest& request, const api::Problem& problem) override;
  void Answered(const HttpRecord& record) noexcept override;
  void ConnectionOpened() noexcept override { metrics_.ConnectionOpened(); }
  void ConnectionClosed() noexcept override { metrics_.ConnectionClosed(); }
  void ConnectionDropped(DropReason reason) noexcept override {
    metrics_.ConnectionDropped(reason);
  }
  void AcceptFailed() noexcept override { metrics_.AcceptFailed(); }

  /// The number of requests whose client left before the answer.
  std::uint64_t clients_gone() const { return clients_gone_; }

  /// From now on clients need one of these tokens. No effect if the service began without tokens.
  void ReplaceTokens(BearerTokens tokens) {
    if (tokens_) tokens_->Replace(std::move(tokens));
  }
  /// After it, only open routes and requests of connections that came before are answered; other
  /// requests get `draining`.
  void Drain() { draining_ = true; }

  const api::Limits& limits() const { return options_.limits; }
  /// Bytes of request memory in use.
  std::uint64_t request_memory_used() const { return memory_.used(); }

 private:
  api::Outcome<HttpResponse> Answer(const HttpRequest& request, const RouteMatch& match,
                                    ServerTiming& timing, std::string_view& route);
  bool IsAllowed(const HttpRequest& request) const;

  const ServiceOptions options_;
  std::optional<TokenGate> tokens_;
  const Log& log_;
  std::atomic<bool> draining_{false};
  std::atomic<std::uint64_t> clients_gone_{0};
  Admission admission_;
  RequestMemory memory_;
  Metrics metrics_;
  const HandlerContext context_;
};

}  // namespace kdray::server
