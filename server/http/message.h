// SPDX-License-Identifier: Apache-2.0
// The daemon's types of requests and answers. The adaptor (http_server.h) makes and consumes them;
// no other file depends on the HTTP library.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "api/byte_block.h"
#include "api/errors.h"
#include "api/types.h"
#include "core/base/cancel.h"

namespace kdray::server {

/// Header fields in the order in which they are received or sent. Names are case-insensitive.
class HttpHeaders {
 public:
  /// Appends a field; a second one of the same name is kept beside the first.
  void Add(std::string_view name, std::string_view value);
  /// Replaces every field of that name by this one.
  void Set(std::string_view name, std::string_view value);
  void Remove(std::string_view name);
  /// The first field of that name.
  std::optional<std::string_view> Find(std::string_view name) const;
  std::size_t Count(std::string_view name) const;
  const std::vector<std::pair<std::string, std::string>>& fields() const { return fields_; }

 private:
  std::vector<std::pair<std::string, std::string>> fields_;
};

/// Equal except for the case of ASCII letters.
bool EqualsIgnoringCase(std::string_view a, std::string_view b);

/// A request's connection, as its handler sees it.
class HttpPeer {
 public:
  virtual ~HttpPeer() = default;

  /// Declared length of the request's body; 0 without a body, nullopt if only its end tells it
  /// (chunked).
  virtual std::optional<std::uint64_t> body_size() const = 0;
  /// Fills at most `out` with the next bytes of the body and returns their number; 0 at its end.
  /// The first call sends 100 Continue to a client that waits for it, so reject the request before.
  /// request_timeout for a slow client, malformed_request if the body ends early or its chunks are
  /// malformed.
  virtual api::Outcome<std::size_t> ReadBody(std::span<std::byte> out) = 0;
  /// Cancels `token` if the client leaves during the lifetime of the returned handle. A client that
  /// only closes its sending side has not left. One handle at a time.
  virtual std::shared_ptr<void> CancelWhenGone(const core::CancelToken& token) = 0;
};

struct HttpRequest {
  std::string method;
  std::string path;          ///< as sent, still percent-encoded
  std::string query_string;  ///< after the '?', still percent-encoded
  HttpHeaders headers;
  std::string remote_addr;
  HttpPeer* peer =
      nullptr;  ///< valid while the request is handled; null for a request with an invalid head
  std::chrono::steady_clock::time_point received;  ///< the time when its head was complete
  /// Its connection was open when the server began to drain: it is still served, as the last one of
  /// its connection.
  bool came_before_drain = false;
};

/// The bytes of an answer: owned, in one piece or several; static; or read while they are sent.
class HttpBody {
 public:
  /// Fills `out` from `offset`; false aborts the answer. Called with growing offsets by one thread.
  using Reader = std::function<bool(std::uint64_t offset, std::span<std::byte> out)>;

  HttpBody() = default;
  HttpBody(std::string text);              // NOLINT(google-explicit-constructor)
  HttpBody(std::vector<std::byte> bytes);  // NOLINT(google-explicit-constructor)
  /// Several pieces, sent one after the other; none is empty. `owner` lives as long as they.
  HttpBody(std::vector<api::ByteBlock> pieces, std::shared_ptr<const void> owner);
  /// Static bytes (embedded files).
  static HttpBody Static(std::string_view bytes);
  static HttpBody Streamed(std::uint64_t size, Reader reader);
  /// Pieces of memory that `owner` keeps, sent one after the other; none is empty.
  static HttpBody Of(const std::vector<std::string_view>& pieces,
                     std::shared_ptr<const void> owner);

  /// Keeps `owner` as long as the bytes; for what is charged for them.
  void Own(std::shared_ptr<const void> owner);

  std::uint64_t size() const { return size_; }
  /// Null unless the body is streamed.
  const Reader& reader() const { return reader_; }
  /// The bytes from `offset` < size() that lie in one piece; empty if the body is streamed.
  std::string_view BytesFrom(std::uint64_t offset) const;
  /// All bytes, if they lie in one piece.
  std::string_view text() const { return size_ == 0 ? std::string_view() : BytesFrom(0); }

 private:
  struct Piece {
    std::uint64_t offset;
    std::string_view bytes;
  };

  std::shared_ptr<const void> owner_;
  std::vector<Piece> pieces_;  ///< by offset
  std::uint64_t size_ = 0;
  Reader reader_;
};

struct HttpResponse {
  int status = 200;
  HttpHeaders headers;
  HttpBody body;
  std::string error_code;  ///< wire name of the problem, for the log; empty for a success
  std::string cause;       ///< for the log, not sent
  std::string_view route;  ///< the template of the path whose handler answered; static, or empty
  bool close = false;      ///< end the connection after this answer
};

/// The status of a request whose client left before the answer. Logged, never sent.
constexpr int kClientGone = 499;

/// One answered request, for the log.
struct HttpRecord {
  std::string method, path, query_string, remote_addr, request_id, error_code, cause;
  /// Of the client's trace (trace_context.h); empty without one.
  std::string trace_id, parent_id;
  std::string_view route;  ///< as in HttpResponse
  int status = 0;
  std::uint64_t bytes_in = 0;   ///< of the body
  std::uint64_t bytes_out = 0;  ///< head included
  double ms = 0;                ///< from the complete head to the last byte handed over
  bool complete = false;        ///< the client took the whole answer
};

/// Why a connection was ended for want of room.
enum class DropReason : std::uint8_t {
  kEvicted,  ///< idle, or its client slow; another one took its place
  kRefused,  ///< new, and answered with `overloaded`
  kClosed,   ///< new, and closed without an answer
};

/// The service that the adaptor calls, from many threads at once.
class HttpHandler {
 public:
  virtual ~HttpHandler() = default;
  virtual HttpResponse Handle(const HttpRequest& request) = 0;
  /// The answer to an invalid request; `request` has the parts that are known.
  virtual HttpResponse Refuse(const HttpRequest& request, const api::Problem& problem) = 0;
  virtual void Answered(const HttpRecord& record) noexcept = 0;
  /// A connection was accepted, and one was closed.
  virtual void ConnectionOpened() noexcept {}
  virtual void ConnectionClosed() noexcept {}
  virtual void ConnectionDropped(DropReason) noexcept {}
  /// The system accepted no connection, for want of descriptors or memory. Called for each attempt.
  virtual void AcceptFailed() noexcept {}
};

}  // namespace kdray::server
