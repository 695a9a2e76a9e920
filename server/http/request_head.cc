// SPDX-License-Identifier: Apache-2.0
#include "server/http/request_head.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;

bool IsTokenChar(char c) {
  if ((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9')) return true;
  return std::string_view("!#$%&'*+-.^_`|~").find(c) != std::string_view::npos;
}

bool IsToken(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), IsTokenChar);
}

/// Printable ASCII without the space; fragments are never sent.
bool IsTargetChar(char c) { return c > ' ' && c < '\x7f' && c != '#'; }

std::string_view Trim(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

/// Whether a comma-separated list names `token`.
bool ListHas(std::string_view list, std::string_view token) {
  while (!list.empty()) {
    const auto comma = list.find(',');
    if (EqualsIgnoringCase(Trim(list.substr(0, comma)), token)) return true;
    if (comma == std::string_view::npos) break;
    list.remove_prefix(comma + 1);
  }
  return false;
}

Problem Malformed(std::string detail) {
  return Problem{.code = ErrorCode::kMalformedRequest, .detail = std::move(detail)};
}

/// Removes the next line from `text`. nullopt for a line that does not end in CRLF.
std::optional<std::string_view> TakeLine(std::string_view& text) {
  const auto feed = text.find('\n');
  if (feed == std::string_view::npos || feed == 0 || text[feed - 1] != '\r') return std::nullopt;
  const std::string_view line = text.substr(0, feed - 1);
  text.remove_prefix(feed + 1);
  return line;
}

class HeadParser {
 public:
  HeadParser(std::string_view text, const HeadLimits& limits) : rest_(text), limits_(limits) {}

  std::optional<Problem> Parse() {
    // RFC 9112, 2.2: an empty line before the request line is ignored.
    if (rest_.starts_with("\r\n")) rest_.remove_prefix(2);
    if (auto problem = ParseRequestLine()) return problem;
    if (auto problem = ParseFields()) return problem;
    if (auto problem = CheckHost()) return problem;
    if (auto problem = CheckFraming()) return problem;
    head_.expects_continue = EqualsIgnoringCase(Value("Expect"), "100-continue") && !head_.is_1_0;
    return std::nullopt;
  }
  RequestHead& head() { return head_; }

 private:
  std::string_view Value(std::string_view name) const {
    return head_.headers.Find(name).value_or(std::string_view());
  }

  std::optional<Problem> ParseRequestLine() {
    const auto line = TakeLine(rest_);
    if (!line) return Malformed("the request line must end in CR LF");
    const auto first = line->find(' ');
    const auto last = line->rfind(' ');
    if (first == std::string_view::npos || first == last) {
      return Malformed("the request line must be METHOD TARGET HTTP/1.1");
    }
    const std::string_view method = line->substr(0, first);
    std::string_view target = line->substr(first + 1, last - first - 1);
    const std::string_view version = line->substr(last + 1);
    if (!IsToken(method)) return Malformed("the method is not a token");
    head_.method = method;
    if (target.size() > limits_.uri_bytes) {
      return Problem{.code = ErrorCode::kUriTooLong,
                     .detail = "the request target has " + std::to_string(target.size()) +
                               " bytes, at most " + std::to_string(limits_.uri_bytes) +
                               " are allowed; send the fields of a render as JSON with POST",
                     .limit = static_cast<double>(limits_.uri_bytes),
                     .actual = static_cast<double>(target.size())};
    }
    if (!std::all_of(target.begin(), target.end(), IsTargetChar)) {
      return Malformed("the request target has a character that must be percent-encoded");
    }
    if (version != "HTTP/1.1" && version != "HTTP/1.0") {
      return Malformed("only HTTP/1.1 and HTTP/1.0 are supported");
    }
    head_.is_1_0 = version == "HTTP/1.0";
    return SetTarget(target);
  }

  std::optional<Problem> SetTarget(std::string_view target) {
    // Absolute-form (RFC 9112, 3.2.2), which clients send to proxies and every server must accept.
    constexpr std::string_view kScheme = "http://";
    if (target.size() > kScheme.size() &&
        EqualsIgnoringCase(target.substr(0, kScheme.size()), kScheme)) {
      target.remove_prefix(kScheme.size());
      target.remove_prefix(std::min(target.find_first_of("/?"), target.size()));
      if (!target.starts_with('/')) {
        head_.path = "/";
        head_.query_string = target.substr(std::min<std::size_t>(1, target.size()));
        return std::nullopt;
      }
    }
    // Asterisk-form (RFC 9112, 3.2.4) is for the server as a whole, and for OPTIONS alone.
    if (!target.starts_with('/') && !(target == "*" && head_.method == "OPTIONS")) {
      return Malformed("the request target must begin with '/'");
    }
    const auto question = target.find('?');
    head_.path = target.substr(0, question);
    if (question != std::string_view::npos) head_.query_string = target.substr(question + 1);
    return std::nullopt;
  }

  std::optional<Problem> ParseFields() {
    for (std::size_t count = 0;; ++count) {
      const auto line = TakeLine(rest_);
      if (!line) return Malformed("header lines must end in CR LF");
      if (line->empty()) break;
      if (count == limits_.fields) {
        return Problem{
            .code = ErrorCode::kHeadersTooLarge,
            .detail = "at most " + std::to_string(limits_.fields) + " header fields are allowed",
            .limit = static_cast<double>(limits_.fields)};
      }
      const auto colon = line->find(':');
      if (colon == std::string_view::npos) return Malformed("a header line has no colon");
      const std::string_view name = line->substr(0, colon);
      // Also rejects folded lines and blanks before the colon.
      if (!IsToken(name)) return Malformed("a header name is not a token");
      const std::string_view value = Trim(line->substr(colon + 1));
      if (!std::all_of(value.begin(), value.end(), IsFieldValueChar)) {
        return Malformed("a header value has a control character");
      }
      head_.headers.Add(name, value);
    }
    const std::string_view connection = Value("Connection");
    head_.keep_alive =
        head_.is_1_0 ? ListHas(connection, "keep-alive") : !ListHas(connection, "close");
    return std::nullopt;
  }

  std::optional<Problem> CheckHost() const {
    const std::size_t hosts = head_.headers.Count("Host");
    if (hosts > 1) return Malformed("there is more than one Host header");
    if (hosts == 0 && !head_.is_1_0) return Malformed("the Host header is missing");
    return std::nullopt;
  }

  std::optional<Problem> CheckFraming() {
    const std::size_t lengths = head_.headers.Count("Content-Length");
    if (head_.headers.Count("Transfer-Encoding") != 0) return CheckTransferEncoding();
    if (lengths == 0) return std::nullopt;
    if (lengths > 1) return Malformed("there is more than one Content-Length header");
    const std::string_view digits = Value("Content-Length");
    if (digits.empty() ||
        !std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; })) {
      return Malformed("Content-Length must be a decimal number");
    }
    constexpr std::uint64_t kMax = std::numeric_limits<std::uint64_t>::max();
    for (const char c : digits) {
      const auto digit = static_cast<std::uint64_t>(c - '0');
      head_.content_length =
          head_.content_length > (kMax - digit) / 10 ? kMax : head_.content_length * 10 + digit;
    }
    return head_.content_length > 0 ? CheckMethodTakesBody() : std::nullopt;
  }

  std::optional<Problem> CheckTransferEncoding() {
    if (head_.headers.Count("Content-Length") != 0) {
      return Malformed("Content-Length and Transfer-Encoding exclude each other");
    }
    // RFC 9112, 6.1: its length is uncertain, because HTTP/1.0 knows no transfer coding.
    if (head_.is_1_0) return Malformed("a request of HTTP/1.0 has no Transfer-Encoding");
    const std::string_view coding = Value("Transfer-Encoding");
    if (head_.headers.Count("Transfer-Encoding") != 1 || !EqualsIgnoringCase(coding, "chunked")) {
      return Problem{.code = ErrorCode::kLengthRequired,
                     .detail = "Transfer-Encoding must be 'chunked' alone; or send Content-Length",
                     .parameter = "Transfer-Encoding"};
    }
    head_.chunked = true;
    return CheckMethodTakesBody();
  }

  std::optional<Problem> CheckMethodTakesBody() const {
    if (head_.method == "POST" || head_.method == "PUT" || head_.method == "PATCH") {
      return std::nullopt;
    }
    return Malformed("a " + head_.method + " request has no body here");
  }

  std::string_view rest_;
  const HeadLimits& limits_;
  RequestHead head_;
};

}  // namespace

std::variant<RequestHead, RefusedHead> ParseRequestHead(std::string_view text,
                                                        const HeadLimits& limits) {
  HeadParser parser(text, limits);
  if (auto problem = parser.Parse()) {
    RequestHead& known = parser.head();
    if (known.headers.fields().empty()) known.headers = FindOrigin(text);
    return RefusedHead{std::move(known), *std::move(problem)};
  }
  return std::move(parser.head());
}

HttpHeaders FindOrigin(std::string_view text) {
  constexpr std::string_view kName = "origin:";
  HttpHeaders headers;
  for (auto feed = text.find('\n'); feed != std::string_view::npos; feed = text.find('\n')) {
    text.remove_prefix(feed + 1);
    if (!EqualsIgnoringCase(text.substr(0, kName.size()), kName)) continue;
    const auto end = text.find('\r');
    if (end == std::string_view::npos) break;
    const std::string_view value = Trim(text.substr(kName.size(), end - kName.size()));
    if (std::all_of(value.begin(), value.end(), IsFieldValueChar)) headers.Add("Origin", value);
  }
  return headers;
}

bool IsFieldValueChar(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return byte == '\t' || (byte >= ' ' && byte != 0x7f);
}

bool IsFieldLine(std::string_view line) {
  const auto colon = line.find(':');
  if (colon == std::string_view::npos || !IsToken(line.substr(0, colon))) return false;
  const std::string_view value = line.substr(colon + 1);
  return std::all_of(value.begin(), value.end(), IsFieldValueChar);
}

std::size_t FindHeadEnd(std::string_view text, std::size_t from) {
  // A line begins at 0 and after each line feed; an empty line that is not the first ends the head.
  // One empty line before the request line is ignored, as in Parse().
  std::size_t start = text.starts_with("\r\n") ? 2 : text.starts_with("\n") ? 1 : 0;
  std::size_t feed = text.find('\n', std::max(from > 2 ? from - 2 : 0, start));
  while (feed != std::string_view::npos) {
    const std::string_view behind = text.substr(feed + 1);
    if (behind.starts_with('\n')) return feed + 2;
    if (behind.starts_with("\r\n")) return feed + 3;
    feed = text.find('\n', feed + 1);
  }
  return 0;
}

}  // namespace kdray::server
