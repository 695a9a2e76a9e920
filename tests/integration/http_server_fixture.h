// SPDX-License-Identifier: Apache-2.0
// The adaptor on a real socket, with a handler that tells what reached it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "server/http/http_server.h"
#include "tests/support/recording_handler.h"

namespace kdray::server {

/// Answers 200 with `METHOD path body`; some paths do something else.
class EchoHandler final : public test::RecordingHandler {
 public:
  HttpResponse Handle(const HttpRequest& request) override {
    ++handled;
    HttpResponse response;
    if (request.path == "/throw") throw std::runtime_error("secret /etc/x");
    if (request.path == "/throw-other") throw 42;
    if (request.path == "/throw-memory") throw std::bad_alloc();
    if (request.path == "/throw-always") {
      throws_always = true;
      throw std::runtime_error("secret");
    }
    if (request.path == "/throw-in-body") {
      response.body = HttpBody::Streamed(100, [](std::uint64_t, std::span<std::byte>) -> bool {
        throw std::runtime_error("secret");
      });
      return response;
    }
    if (request.path == "/empty") {
      response.status = 204;
      return response;
    }
    if (request.path == "/refuse-unread") {
      response.status = 413;
      return response;
    }
    if (request.path == "/large") {
      response.body = std::string(8 << 20, 'x');
      return response;
    }
    if (request.path == "/streamed") {
      response.body =
          HttpBody::Streamed(300'000, [](std::uint64_t offset, std::span<std::byte> out) {
            for (std::size_t i = 0; i < out.size(); ++i) {
              out[i] = static_cast<std::byte>('a' + (offset + i) % 26);
            }
            return true;
          });
      return response;
    }
    if (request.path == "/pieces") {
      std::vector<api::ByteBlock> pieces;
      char next = 'a';
      for (std::size_t left = 300'000, size = 1; left > 0; left -= size) {
        size = std::min(3 * size + 1, left);
        pieces.emplace_back(size);
        for (std::size_t i = 0; i < size; ++i) {
          pieces.back().data()[i] = next;
          next = next == 'z' ? 'a' : static_cast<char>(next + 1);
        }
      }
      response.body = HttpBody(std::move(pieces), nullptr);
      return response;
    }
    if (request.path == "/wait") WorkUntilLetGo(request);
    std::string text = request.method + " " + request.path + " ";
    if (const auto problem = ReadBody(request, &text)) return Refuse(request, *problem);
    response.body = std::move(text);
    response.headers.Add("Content-Type", "text/plain");
    response.headers.Add("X-Split", "a\r\nSet-Cookie: b");
    return response;
  }

  void ConnectionDropped(DropReason reason) noexcept override {
    ++(reason == DropReason::kEvicted ? evicted : refused);
  }

  HttpResponse Refuse(const HttpRequest& request, const api::Problem& problem) override {
    if (throws_always.exchange(false)) throw std::logic_error("secret");
    return RecordingHandler::Refuse(request, problem);
  }

  std::atomic<bool> throws_always{false};
  std::atomic<int> handled{0};
  std::atomic<int> evicted{0}, refused{0};
};

class HttpServerTest : public testing::Test {
 protected:
  explicit HttpServerTest(HttpServerOptions options = {})
      : server_(WithFreePort(options), handler_) {
    const auto problem = server_.Bind();
    EXPECT_FALSE(problem) << *problem;
    server_.Start();
  }
  ~HttpServerTest() override {
    handler_.let_go = true;
    server_.Stop();
  }
  static HttpServerOptions WithFreePort(HttpServerOptions options) {
    options.port = 0;
    return options;
  }
  int port() const { return server_.port(); }

  EchoHandler handler_;
  HttpServer server_;
};

}  // namespace kdray::server
