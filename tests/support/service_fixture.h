// SPDX-License-Identifier: Apache-2.0
// The service on a free port of this process, over any backend.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "server/http/http_server.h"
#include "server/service.h"
#include "tests/support/raw_client.h"

namespace kdray::test {

/// An answer with its body as JSON.
inline nlohmann::json Json(const RawAnswer& answer) { return nlohmann::json::parse(answer.body); }

class RunningService {
 public:
  explicit RunningService(server::Backend& backend, server::ServiceOptions options = {},
                          server::HttpServerOptions http = {})
      : service_(std::move(options), backend, log_),
        server_(WithFreePort(std::move(http)), service_) {
    const auto problem = server_.Bind();
    EXPECT_FALSE(problem) << *problem;
    server_.Start();
  }

  int port() const { return server_.port(); }
  server::Service& service() { return service_; }
  server::HttpServer& server() { return server_; }

  /// One request on a new connection. Fails the test without an answer.
  RawAnswer Ask(std::string_view method, std::string_view path, std::string_view body = {},
                std::string_view header_lines = {}) {
    auto answer =
        test::Ask(port(), MakeRequest(method, path, body, header_lines), method == "HEAD");
    if (!answer) ADD_FAILURE() << "no answer to " << method << " " << path;
    return answer.value_or(RawAnswer());
  }
  /// The id of an uploaded mesh.
  std::string Upload(std::string_view mesh, const std::string& query = "") {
    const RawAnswer answer = Ask("POST", "/v1/trees" + query, mesh);
    EXPECT_LT(answer.status, 300) << answer.body;
    return answer.status < 300 ? Json(answer).at("id").get<std::string>() : std::string();
  }
  /// The `code` of the problem that the request is refused with, or the status of an answer that is
  /// none.
  std::string Code(std::string_view method, std::string_view path, std::string_view body = {},
                   std::string_view header_lines = {}) {
    return CodeOf(Ask(method, path, body, header_lines));
  }
  static std::string CodeOf(const RawAnswer& answer) {
    if (answer.Header("content-type") != "application/problem+json") {
      return std::to_string(answer.status);
    }
    return Json(answer).at("code");
  }

 private:
  static server::HttpServerOptions WithFreePort(server::HttpServerOptions options) {
    options.port = 0;
    return options;
  }

  const server::Log log_{-1};
  server::Service service_;
  server::HttpServer server_;
};

}  // namespace kdray::test
