// SPDX-License-Identifier: Apache-2.0
#include "server/http/exchange.h"

#include <exception>
#include <new>
#include <utility>

#include "server/http/trace_context.h"

namespace kdray::server {
namespace {

using Clock = std::chrono::steady_clock;
using api::ErrorCode;
using api::Problem;

/// The beginning of every answer. Sent byte by byte to a client that has closed its sending side,
/// it shows whether the client is still there, and does not depend on the answer.
constexpr std::string_view kAnswerStart = "HTTP/1.1 ";
/// The longest rest of a body that is read for nothing to keep the connection. A new connection
/// costs about as much.
constexpr std::uint64_t kMostSkippedBytes = std::uint64_t{4} << 20;
/// Wait for a reset from the client's system after an incomplete body.
constexpr std::chrono::milliseconds kResetWait{100};

Problem InternalProblem() {
  return Problem{.code = ErrorCode::kInternal, .detail = "the request could not be finished"};
}

}  // namespace

Exchange::Exchange(Connection& connection, DepartureWatch& watch, const PaceLimit& body_pace,
                   std::string remote_addr)
    : connection_(connection), watch_(watch), body_pace_(body_pace) {
  request_.remote_addr = std::move(remote_addr);
}

void Exchange::Accept(RequestHead head) {
  body_size_ = head.chunked ? std::nullopt : std::optional(head.content_length);
  expects_continue_ = head.expects_continue;
  keep_alive_ = head.keep_alive;
  is_1_0_ = head.is_1_0;
  SetRequest(std::move(head));
  request_.peer = this;
  connection_.BeginBody(body_size_, body_pace_);
}

void Exchange::Refuse(RefusedHead refused) {
  SetRequest(std::move(refused.known));
  refusal_ = std::move(refused.problem);
}

void Exchange::Answer(HttpHandler& handler) {
  try {
    response_ = refusal_ ? handler.Refuse(request_, *refusal_) : handler.Handle(request_);
  } catch (const std::bad_alloc&) {
    response_ = handler.Refuse(request_, Problem{.code = ErrorCode::kMemoryFull,
                                                 .detail = "there was no memory for this request"});
  } catch (const std::exception& error) {
    response_ = handler.Refuse(request_, InternalProblem());
    response_.cause = error.what();
  } catch (...) {
    response_ = handler.Refuse(request_, InternalProblem());
    response_.cause = "an exception of unknown type";
  }
  if (gone_) {
    response_.status = kClientGone;
    response_.error_code = "client_gone";
    response_.cause.clear();
    response_.body = HttpBody();
  }
  // After an error the connection is not trusted any more; unread bytes of a body are not the next
  // request. But a server that has too much to do must not add connections to it.
  constexpr int kServiceUnavailable = 503;
  const bool is_trusted = response_.status < 400 || response_.status == kServiceUnavailable;
  const bool can_skip = response_.status == kServiceUnavailable && !expects_continue_ &&
                        body_size_ && *body_size_ - connection_.body_bytes() <= kMostSkippedBytes;
  response_.close = response_.close || !is_trusted || !keep_alive_ || refusal_.has_value() ||
                    !(connection_.is_body_complete() || can_skip);
}

bool Exchange::SkipBody() { return connection_.SkipBody() == Connection::Read::kDone; }

HttpRecord Exchange::Record(Clock::time_point start) const {
  HttpRecord record;
  record.method = request_.method;
  record.path = request_.path;
  record.query_string = request_.query_string;
  record.remote_addr = request_.remote_addr;
  record.request_id = response_.headers.Find("X-Request-Id").value_or("");
  record.error_code = response_.error_code;
  record.cause = response_.cause;
  record.route = response_.route;
  record.status = response_.status;
  record.bytes_in = refusal_ ? 0 : connection_.body_bytes();
  record.bytes_out = connection_.written();
  record.ms = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  record.complete = complete_;
  if (request_.headers.Count("traceparent") == 1) {
    if (const auto trace = ParseTraceparent(*request_.headers.Find("traceparent"))) {
      record.trace_id = trace->trace_id;
      record.parent_id = trace->parent_id;
    }
  }
  return record;
}

api::Outcome<std::size_t> Exchange::ReadBody(std::span<std::byte> out) {
  if (expects_continue_) {
    expects_continue_ = false;
    if (!connection_.has_buffered_input() && !connection_.is_body_complete()) {
      connection_.Write("HTTP/1.1 100 Continue\r\n\r\n");
      connection_.Flush();
    }
  }
  std::size_t count = 0;
  switch (connection_.ReadBody(out, &count)) {
    case Connection::Read::kDone:
      return count;
    case Connection::Read::kTimeout:
      return Problem{.code = ErrorCode::kRequestTimeout,
                     .detail = "the body came too slowly: " + Received()};
    case Connection::Read::kMalformed:
      return Problem{.code = ErrorCode::kMalformedRequest,
                     .detail = "the chunked body is malformed after " +
                               std::to_string(connection_.body_bytes()) +
                               " bytes of data: " + std::string(connection_.body_problem())};
    default:
      gone_ = connection_.HasLeft(kAnswerStart, kResetWait);
      return Problem{.code = ErrorCode::kMalformedRequest,
                     .detail = "the body ended early: " + Received()};
  }
}

std::shared_ptr<void> Exchange::CancelWhenGone(const core::CancelToken& token) {
  return watch_.Watch(connection_.fd(), token, *this);
}

bool Exchange::Probe() { return connection_.SendAhead(kAnswerStart); }

std::string Exchange::Received() const {
  const std::string received = std::to_string(connection_.body_bytes());
  if (!body_size_) return received + " bytes were received, without a last chunk";
  return received + " of " + std::to_string(*body_size_) + " bytes were received";
}

void Exchange::SetRequest(RequestHead head) {
  request_.method = std::move(head.method);
  request_.path = std::move(head.path);
  request_.query_string = std::move(head.query_string);
  request_.headers = std::move(head.headers);
  request_.received = Clock::now();
}

}  // namespace kdray::server
