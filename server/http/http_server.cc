// SPDX-License-Identifier: Apache-2.0
// cpp-httplib binds the socket and writes answers. What it does not do, and why:
//
// - It reads no request. Its reader takes bare line feeds, negative and repeated lengths, chunk
//   sizes with signs, unlimited lines and header counts, and decodes percent signs in header
//   values. A body that it does not read becomes the next request. So Connection and
//   ParseRequestHead() read the head, and Connection reads the body. The library's own parser sees
//   one line that never changes (kPlaceholder); then it is given the head that was validated.
// - It keeps no connection. Its loop polls a hundred times a second and drops what was read too
//   far. Ours keeps one Connection.
// - It routes nothing, serves no files, ranges or compression: the pre-routing handler answers
//   everything.
// - It does not accept: an error of accept() ends its loop, or is tried again without a
//   report that no descriptor is free. Listener accepts.
//
// Checked against versions 0.11 (Debian 12) and 0.18 (Debian 13). Where they differ, the code below
// says so; another version needs a new look at this file only.
#include "server/http/http_server.h"

#include <httplib.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <exception>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include "server/http/connection_pool.h"
#include "server/http/departure_watch.h"
#include "server/http/exchange.h"
#include "server/http/listener.h"
#include "server/http/time_text.h"

namespace kdray::server {
namespace {

using Clock = std::chrono::steady_clock;
using api::ErrorCode;
using api::Problem;

constexpr int kBacklog = 1024;
constexpr std::size_t kStreamBytes = 64 * 1024;
/// For the answers of cancelled work, which ends within 250 ms.
constexpr std::chrono::milliseconds kCancelTime{1000};

/// The only text that the library's parser reads; Show() replaces the result.
constexpr std::string_view kPlaceholder = "GET / HTTP/1.1\r\n\r\n";

/// Gives the library the head that ParseRequestHead() has validated.
void Show(const HttpRequest& from, httplib::Request& to) {
  if (from.method.empty()) return;  // the head was invalid
  to.method = from.method;
  to.path = from.path;
  to.target = from.query_string.empty() ? from.path : from.path + "?" + from.query_string;
  for (const auto& [name, value] : from.headers.fields()) {
    // Exchange sends 100 Continue when the handler reads the body.
    if (!EqualsIgnoringCase(name, "Expect")) to.headers.emplace(name, value);
  }
}

/// Replaces a socket for the library.
class LibraryStream final : public httplib::Stream {
 public:
  explicit LibraryStream(Connection& connection) : connection_(connection) {}

  bool is_readable() const override { return !unread_.empty(); }
  bool is_writable() const override { return true; }
  ssize_t read(char* out, size_t size) override {
    const std::size_t count = unread_.copy(out, size);
    unread_.remove_prefix(count);
    return static_cast<ssize_t>(count);
  }
  // Never 0, which the library would retry for ever.
  ssize_t write(const char* bytes, size_t size) override {
    return connection_.Write({bytes, size}) ? static_cast<ssize_t>(size) : -1;
  }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}
  socket_t socket() const override { return INVALID_SOCKET; }

 private:
  Connection& connection_;
  std::string_view unread_ = kPlaceholder;
};

/// Gives the body to the library. Exceptions must not pass through the library, where they would
/// end the process.
bool SendBody(const HttpBody& body, std::uint64_t offset, std::uint64_t length,
              httplib::DataSink& sink) noexcept {
  try {
    if (body.reader() == nullptr) {
      const std::string_view bytes = body.BytesFrom(offset).substr(0, length);
      return sink.write(bytes.data(), bytes.size());
    }
    std::vector<std::byte> piece(std::min<std::uint64_t>(length, kStreamBytes));
    if (!body.reader()(offset, piece)) return false;
    return sink.write(reinterpret_cast<const char*>(piece.data()), piece.size());
  } catch (...) {
    return false;
  }
}

std::string RemoteAddress(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof(address);
  char text[NI_MAXHOST];
  if (getpeername(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0 ||
      getnameinfo(reinterpret_cast<sockaddr*>(&address), size, text, sizeof(text), nullptr, 0,
                  NI_NUMERICHOST) != 0) {
    return {};
  }
  return text;
}

/// The library's side of one connection: gets the answers and writes them. One object per
/// connection, because the library does not pass the connection to its handlers.
class Responder final : private httplib::Server {
 public:
  Responder(Connection& connection, const ConnectionPool::Slot& slot, HttpHandler& handler)
      : connection_(connection), slot_(slot), handler_(handler) {
    // The library takes a server without a listening socket for one that ends, and sends no body.
    // It neither reads nor closes this one.
    svr_sock_ = connection.fd();
    set_pre_routing_handler([this](const httplib::Request&, httplib::Response& answer) {
      Fill(answer);
      return HandlerResponse::Handled;
    });
    // By default the library sends the exception's text. This handles exceptions thrown while a
    // problem is made.
    set_exception_handler(
        [this](const httplib::Request&, httplib::Response& answer, const std::exception_ptr&) {
          answer.status = 500;
          exchange_->response().close = true;
        });
    set_post_routing_handler(
        [this](const httplib::Request&, httplib::Response& answer) { FinishHeaders(answer); });
  }

  /// False if the client does not take the whole answer.
  bool Answer(Exchange& exchange) {
    exchange_ = &exchange;
    LibraryStream stream(connection_);
    const bool written = ProcessRequest(
        *this, stream, [&](httplib::Request& request) { Show(exchange.request(), request); });
    exchange_ = nullptr;
    return written;
  }

 private:
  /// The library's process_request. Version 0.18 also takes both ends' addresses, for handlers that
  /// ask for them; ours do not. A template, so that only the call that exists is compiled.
  template <class Self, class Setup>
  static bool ProcessRequest(Self& self, httplib::Stream& stream, const Setup& setup) {
    bool closes = false;
    if constexpr (requires { self.process_request(stream, false, closes, setup); }) {
      return self.process_request(stream, false, closes, setup);
    } else {
      return self.process_request(stream, "", 0, "", 0, false, closes, setup);
    }
  }

  void Fill(httplib::Response& answer) {
    exchange_->Answer(handler_);
    HttpResponse& response = exchange_->response();
    response.close = response.close || slot_.must_close();
    answer.status = response.status;
    std::string content_type;
    for (const auto& [name, value] : response.headers.fields()) {
      if (EqualsIgnoringCase(name, "Content-Type")) {
        content_type = value;
      } else {
        answer.set_header(name, value);  // drops a value with CR or LF in it
      }
    }
    answer.set_header("Date", HttpDate(UnixMsNow()));
    if (response.body.size() > 0) {
      answer.set_content_provider(
          response.body.size(), content_type,
          [&body = response.body](size_t offset, size_t length, httplib::DataSink& sink) {
            return SendBody(body, offset, length, sink);
          });
    }
  }

  /// Removes headers that the library adds.
  void FinishHeaders(httplib::Response& answer) const {
    answer.headers.erase("Keep-Alive");
    answer.headers.erase("Accept-Ranges");
    answer.headers.erase("Connection");
    if (const std::string_view option = exchange_->connection_option(); !option.empty()) {
      answer.set_header("Connection", std::string(option));
    }
    // RFC 9110, 8.6: never in a 204; in a 304 it would be the length of the answer that was not
    // sent.
    if (answer.status == 204 || answer.status == 304) answer.headers.erase("Content-Length");
  }

  Connection& connection_;
  const ConnectionPool::Slot& slot_;
  HttpHandler& handler_;
  Exchange* exchange_ = nullptr;  ///< the exchange that is answered
};

}  // namespace

class HttpServer::Impl final : private httplib::Server {
 public:
  Impl(HttpServerOptions options, HttpHandler& handler)
      : options_(std::move(options)),
        handler_(handler),
        pool_(
            options_.max_connections,
            [this](int fd, ConnectionPool::Slot& slot) { Serve(fd, slot); },
            [this](DropReason reason) { handler_.ConnectionDropped(reason); }) {
    set_tcp_nodelay(true);
    // Not SO_REUSEPORT, the library's default, with which a second daemon would silently share the
    // port.
    set_socket_options([](socket_t socket) {
      const int yes = 1;
      setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
    });
  }
  ~Impl() override { Stop(); }

  std::optional<std::string> Bind() {
    errno = 0;
    if (options_.port == 0) {
      port_ = bind_to_any_port(options_.host);
    } else {
      port_ = bind_to_port(options_.host, options_.port) ? options_.port : -1;
    }
    if (port_ < 0) {
      const std::string reason = errno == 0 ? "no such address" : std::strerror(errno);
      return "cannot listen on " + options_.host + ":" + std::to_string(options_.port) + ": " +
             reason;
    }
    try {
      listener_.emplace(svr_sock_.exchange(INVALID_SOCKET), kBacklog, ListenerEvents());
    } catch (const std::system_error& error) {
      return "cannot listen: " + std::string(error.what());
    }
    return std::nullopt;
  }
  int port() const { return port_; }

  void Start() { listener_->Start(); }

  void Drain() {
    pool_.Drain();
    listener_->Wake();
  }

  bool WaitUntilIdle(Clock::time_point deadline) {
    if (!pool_.WaitUntilEmpty(deadline)) return false;
    listener_->CloseQueue();
    return pool_.WaitUntilEmpty(deadline);
  }

  void CancelWork() {
    watch_.CancelAll();
    pool_.WaitUntilEmpty(Clock::now() + kCancelTime);
  }

  void Stop() {
    if (listener_) listener_->Stop();
    watch_.CancelAll();
    pool_.Stop();
  }

 private:
  Listener::Events ListenerEvents() {
    return {.accepted =
                [this](int fd) {
                  const int yes = 1;
                  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof(yes));
                  pool_.Accept(fd);
                },
            .exhausted =
                [this] {
                  handler_.AcceptFailed();
                  return pool_.MakeRoom();
                },
            .refused = [this](int fd) { pool_.Shed(fd); },
            .tick = [this] { pool_.EndIdle(options_.drain_grace); }};
  }

  /// Serves one connection to its end.
  void Serve(int fd, ConnectionPool::Slot& slot) noexcept {
    handler_.ConnectionOpened();
    try {
      Connection connection(fd, &slot.late_since());
      Responder responder(connection, slot, handler_);
      const std::string remote_addr = RemoteAddress(fd);
      auto wait = options_.head_timeout;  // a new connection is expected to send a request
      while (ServeOne(connection, responder, slot, remote_addr, wait) && slot.BecomeIdle()) {
        wait = options_.idle_timeout;
      }
      slot.BecomeLingering();
      connection.CloseGently();
    } catch (...) {
      // Out of memory outside a request: only the connection is lost.
    }
    handler_.ConnectionClosed();
  }

  /// False if the connection must be closed.
  bool ServeOne(Connection& connection, Responder& responder, ConnectionPool::Slot& slot,
                const std::string& remote_addr, std::chrono::milliseconds wait) {
    Exchange exchange(connection, watch_, options_.body_pace, remote_addr);
    if (slot.shed()) {
      exchange.Refuse({{},
                       Problem{.code = ErrorCode::kOverloaded,
                               .detail = "the server is at its limit of connections",
                               .limit = static_cast<double>(options_.max_connections)}});
    } else {
      if (connection.WaitForByte(wait) != Connection::Read::kDone ||
          (!connection.has_head() && !slot.BecomeReading()) || !ReadHead(connection, exchange) ||
          !slot.BecomeBusy()) {
        return false;
      }
      exchange.set_came_before_drain(!slot.is_late());
    }
    const auto start = Clock::now();
    connection.BeginWrite(options_.answer_pace);
    const bool written = responder.Answer(exchange);
    exchange.set_complete(connection.Flush() && written);
    handler_.Answered(exchange.Record(start));
    if (exchange.response().close || !written || !exchange.SkipBody()) return false;
    connection.EndRequest();
    return true;
  }

  /// False if the client left without a request.
  bool ReadHead(Connection& connection, Exchange& exchange) {
    switch (connection.ReadHead(Clock::now() + options_.head_timeout, options_.head.bytes)) {
      case Connection::Read::kDone: {
        auto parsed = ParseRequestHead(connection.head(), options_.head);
        if (auto* head = std::get_if<RequestHead>(&parsed)) {
          exchange.Accept(std::move(*head));
        } else {
          exchange.Refuse(std::get<RefusedHead>(std::move(parsed)));
        }
        return true;
      }
      case Connection::Read::kTimeout:
        exchange.Refuse({{},
                         Problem{.code = ErrorCode::kRequestTimeout,
                                 .detail = "the head of the request was not complete in time"}});
        return true;
      case Connection::Read::kTooLarge: {
        RefusedHead refused{{}, TooLarge(connection.head())};
        refused.known.headers = FindOrigin(connection.head());
        exchange.Refuse(std::move(refused));
        return true;
      }
      default:
        return false;
    }
  }

  Problem TooLarge(std::string_view head) const {
    const bool in_request_line =
        head.substr(0, options_.head.uri_bytes).find('\n') == std::string_view::npos;
    const std::size_t limit = in_request_line ? options_.head.uri_bytes : options_.head.bytes;
    return Problem{.code = in_request_line ? ErrorCode::kUriTooLong : ErrorCode::kHeadersTooLarge,
                   .detail = (in_request_line ? "the request line is longer than "
                                              : "the head is longer than ") +
                             std::to_string(limit) + " bytes",
                   .limit = static_cast<double>(limit)};
  }

  const HttpServerOptions options_;
  HttpHandler& handler_;
  DepartureWatch watch_;
  ConnectionPool pool_;  ///< after what its threads use
  int port_ = -1;
  std::optional<Listener> listener_;
};

HttpServer::HttpServer(HttpServerOptions options, HttpHandler& handler)
    : impl_(std::make_unique<Impl>(std::move(options), handler)) {}
HttpServer::~HttpServer() = default;
std::optional<std::string> HttpServer::Bind() { return impl_->Bind(); }
int HttpServer::port() const { return impl_->port(); }
void HttpServer::Start() { impl_->Start(); }
void HttpServer::Drain() { impl_->Drain(); }
bool HttpServer::WaitUntilIdle(std::chrono::steady_clock::time_point deadline) {
  return impl_->WaitUntilIdle(deadline);
}
void HttpServer::CancelWork() { impl_->CancelWork(); }
void HttpServer::Stop() { impl_->Stop(); }

}  // namespace kdray::server
