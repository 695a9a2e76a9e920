// SPDX-License-Identifier: Apache-2.0
// A client that sends the given bytes unchanged, for invalid requests.
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace kdray::test {

struct RawAnswer {
  int status = 0;
  std::multimap<std::string, std::string> headers;  ///< names in lower case
  std::string body;

  /// The first value of that name (lower case), or empty.
  std::string Header(const std::string& name) const;
};

class RawClient {
 public:
  /// Connects to 127.0.0.1. Fails the test if it cannot.
  explicit RawClient(int port);
  ~RawClient();
  RawClient(const RawClient&) = delete;
  RawClient& operator=(const RawClient&) = delete;

  /// False if the server has closed the connection.
  bool Send(std::string_view bytes);
  /// The next answer; nullopt if the connection ends or `timeout` passes before it is complete.
  /// `to_head`: the request was a HEAD, so no body follows.
  std::optional<RawAnswer> Read(std::chrono::milliseconds timeout = std::chrono::seconds(10),
                                bool to_head = false);
  /// True once some bytes have come, which the next Read() gets; false when the connection ends or
  /// `timeout` passes before.
  bool WaitForBytes(std::chrono::milliseconds timeout = std::chrono::seconds(10));
  /// The bytes until the server closes, or until `timeout` passes.
  std::string ReadToEnd(std::chrono::milliseconds timeout = std::chrono::seconds(10));
  /// True if the server closes within `timeout`; bytes until then are dropped.
  bool IsClosed(std::chrono::milliseconds timeout = std::chrono::seconds(10));
  /// Closes the sending side; reading continues.
  void ShutdownWrite();
  void Close();
  /// Closes like a process that is killed with unread bytes: the server sees a reset.
  void Reset();

 private:
  bool Fill(std::chrono::steady_clock::time_point deadline);

  int fd_ = -1;
  std::string buffer_;
};

/// One request over a new connection.
std::optional<RawAnswer> Ask(int port, std::string_view request, bool is_head = false);

/// `METHOD path HTTP/1.1` with Host, the given header lines (each with CR LF) and, if given, a body
/// with its length.
std::string MakeRequest(std::string_view method, std::string_view path, std::string_view body = {},
                        std::string_view header_lines = {});

}  // namespace kdray::test
