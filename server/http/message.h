// Requests and answers as the daemon's own types. The adaptor (http_server.h) makes and consumes
// them; no other file knows which library carries them.
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

#include "api/errors.h"
#include "api/types.h"
#include "core/base/cancel.h"

namespace kdray::server {

/// Header fields in the order they came or will be sent. Names compare without case.
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

/// Equal but for the case of ASCII letters.
bool EqualsIgnoringCase(std::string_view a, std::string_view b);

/// The connection a request came on, as its handler sees it.
class HttpPeer {
 public:
  virtual ~HttpPeer() = default;

  /// Length of the request's body as declared; 0 when there is none.
  virtual std::uint64_t body_size() const = 0;
  /// Fills at most `out` with the next bytes of the body and says how many; 0 at its end. The first
  /// call tells a client that waits for it to go on (Expect: 100-continue), so refuse before it.
  /// request_timeout for a client that dribbles, malformed_request when the body ends early.
  virtual api::Outcome<std::size_t> ReadBody(std::span<std::byte> out) = 0;
  /// Cancels `token` should the client leave while the returned handle lives. A client that only
  /// closes its sending side stays. One handle at a time.
  virtual std::shared_ptr<void> CancelWhenGone(const core::CancelToken& token) = 0;
};

struct HttpRequest {
  std::string method;
  std::string path;          ///< as it came: still percent-encoded
  std::string query_string;  ///< after the '?', still percent-encoded
  HttpHeaders headers;
  std::string remote_addr;
  HttpPeer* peer = nullptr;  ///< lives as long as the request is handled; null for a request that
                             ///< was refused before it was understood
  std::chrono::steady_clock::time_point received;  ///< when its head was complete
};

/// The bytes of an answer: owned, shared, or read piece by piece while they are sent.
class HttpBody {
 public:
  /// Fills `out` from `offset`; false breaks the answer off. Called with growing offsets by one
  /// thread.
  using Reader = std::function<bool(std::uint64_t offset, std::span<std::byte> out)>;

  HttpBody() = default;
  HttpBody(std::string text);              // NOLINT(google-explicit-constructor)
  HttpBody(std::vector<std::byte> bytes);  // NOLINT(google-explicit-constructor)
  /// Bytes that live as long as the program (embedded files).
  static HttpBody Static(std::string_view bytes);
  static HttpBody Streamed(std::uint64_t size, Reader reader);

  std::uint64_t size() const { return size_; }
  /// Null when the body is streamed.
  const char* data() const { return data_; }
  const Reader& reader() const { return reader_; }
  std::string_view text() const { return {data_, data_ == nullptr ? 0 : std::size_t(size_)}; }

 private:
  std::shared_ptr<const void> owner_;
  const char* data_ = nullptr;
  std::uint64_t size_ = 0;
  Reader reader_;
};

struct HttpResponse {
  int status = 200;
  HttpHeaders headers;
  HttpBody body;
  std::string error_code;  ///< wire name of the problem, for the log; empty for a success
  std::string cause;       ///< what stays in the log and is not sent
  bool close = false;      ///< end the connection after this answer
};

/// The status of a request whose client left before there was an answer. Recorded, never sent.
constexpr int kClientGone = 499;

/// One answered request, for the log.
struct HttpRecord {
  std::string method, path, remote_addr, request_id, error_code, cause;
  int status = 0;
  std::uint64_t bytes_in = 0;   ///< of the body
  std::uint64_t bytes_out = 0;  ///< with the head
  double ms = 0;                ///< from the complete head to the last byte handed over
  bool complete = false;        ///< the client took the whole answer
};

/// What stands behind the adaptor. Called from many threads at once.
class HttpHandler {
 public:
  virtual ~HttpHandler() = default;
  virtual HttpResponse Handle(const HttpRequest& request) = 0;
  /// The answer to a request that the adaptor refuses, of which `request` holds what is known.
  virtual HttpResponse Refuse(const HttpRequest& request, const api::Problem& problem) = 0;
  virtual void Answered(const HttpRecord& record) noexcept = 0;
};

}  // namespace kdray::server
