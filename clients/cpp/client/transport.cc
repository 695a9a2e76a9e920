// SPDX-License-Identifier: Apache-2.0
#include "kdray/transport.h"

#include <httplib.h>

#include <algorithm>
#include <cctype>
#include <exception>
#include <random>
#include <utility>

#include "kdray/error.h"

namespace kdray::client {
namespace {

// The client chooses the request ids: if no answer comes, the id finds the request in the server's
// log.
std::string NewRequestId() {
  static std::random_device device;
  constexpr char kHex[] = "0123456789abcdef";
  std::string id = "kdray-";
  for (int i = 0; i < 12; ++i) id += kHex[device() & 15];
  return id;
}

std::string LowerCase(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool IsConnectFailure(httplib::Error error) {
  return error == httplib::Error::Connection || error == httplib::Error::ConnectionTimeout ||
         error == httplib::Error::SSLConnection || error == httplib::Error::SSLLoadingCerts ||
         error == httplib::Error::SSLServerVerification || error == httplib::Error::BindIPAddress;
}

// cpp-httplib calls back from within its own loops; an exception must not pass through them.
class Callback {
 public:
  template <class Function>
  bool Run(const Function& function) {
    try {
      function();
      return true;
    } catch (...) {
      failure_ = std::current_exception();
      return false;  // makes the library abandon the exchange
    }
  }

  void Rethrow() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  std::exception_ptr failure_;
};

httplib::ContentProvider ProviderOf(const HttpRequest& request, Callback& callback) {
  return [&request, &callback, chunk = std::string()](std::size_t offset, std::size_t length,
                                                      httplib::DataSink& sink) mutable {
    return callback.Run([&] {
      chunk.resize(std::min<std::size_t>(length, 256 << 10));
      request.payload->Read(offset, chunk);
      sink.write(chunk.data(), chunk.size());
      if (request.on_sent) request.on_sent(offset + chunk.size());
    });
  };
}

}  // namespace

struct Transport::Connection {
  std::unique_ptr<httplib::ClientImpl> http;
};

std::string HttpResponse::Header(const std::string& lower_case_name) const {
  const auto header = headers.find(lower_case_name);
  return header == headers.end() ? std::string() : header->second;
}

Transport::Transport(ClientOptions options)
    : options_(std::move(options)), connection_(std::make_unique<Connection>()) {
  // Not httplib::Client, whose regular expression for URLs does not match IPv6 addresses with
  // letters.
  const ServerUrl& server = options_.server;
  if (server.tls)
    connection_->http = std::make_unique<httplib::SSLClient>(server.host, server.port);
  else
    connection_->http = std::make_unique<httplib::ClientImpl>(server.host, server.port);
  httplib::ClientImpl& http = *connection_->http;
  http.set_keep_alive(true);
  http.set_tcp_nodelay(true);  // headers and body are separate writes
  http.set_decompress(false);  // answers are not compressed, so none can expand
  http.set_url_encode(false);  // paths and queries are encoded already
  http.set_connection_timeout(options_.connect_timeout_s);
  http.set_read_timeout(options_.timeout_s);
  http.set_write_timeout(options_.timeout_s);
}

Transport::~Transport() = default;

HttpResponse Transport::Send(const HttpRequest& request) {
  const std::string request_id = NewRequestId();
  httplib::Headers headers = {{"User-Agent", "kdray/" KDRAY_VERSION},
                              {"Accept-Encoding", "identity"},
                              {"X-Request-Id", request_id}};
  if (!options_.token.empty()) headers.emplace("Authorization", "Bearer " + options_.token);
  if (!options_.traceparent.empty()) headers.emplace("traceparent", options_.traceparent);
  if (!request.accept.empty()) headers.emplace("Accept", request.accept);
  if (!request.content_digest.empty()) headers.emplace("Content-Digest", request.content_digest);

  const std::string path = options_.server.prefix + request.path + EncodeQuery(request.query);
  httplib::ClientImpl& http = *connection_->http;
  Callback callback;
  std::string refused_body;  // the body of an error, kept even if a sink gets other bodies
  const auto exchange = [&]() -> httplib::Result {
    if (request.method == "DELETE") return http.Delete(path, headers);
    if (request.method == "POST") {
      if (request.payload == nullptr)
        return http.Post(path, headers, request.body, request.content_type);
      return http.Post(path, headers, request.payload->size(), ProviderOf(request, callback),
                       request.content_type);
    }
    if (!request.sink) return http.Get(path, headers);
    bool refused = false;
    return http.Get(
        path, headers,
        [&refused](const httplib::Response& response) {
          refused = response.status != 200;
          return true;
        },
        [&](const char* data, std::size_t length) {
          if (!refused) return callback.Run([&] { request.sink({data, length}); });
          refused_body.append(data, length);
          return refused_body.size() < (1 << 20);
        });
  };
  httplib::Result result = exchange();
  callback.Rethrow();
  if (!result) {
    const std::string where = options_.server.Text();
    const std::string what = httplib::to_string(result.error());
    if (IsConnectFailure(result.error()))
      throw ConnectionError("cannot connect to " + where + " (" + what +
                            "); is kdrayd running there?");
    throw ConnectionError("the connection to " + where + " broke before the answer was complete (" +
                          what + "); the request was " + request_id);
  }

  HttpResponse response;
  response.status = result->status;
  response.body = std::move(refused_body.empty() ? result->body : refused_body);
  for (const auto& [name, value] : result->headers)
    response.headers.emplace(LowerCase(name), value);
  return response;
}

}  // namespace kdray::client
