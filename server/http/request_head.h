// The head of a request: request line and header fields, read strictly. What two readers could
// understand differently is refused, because a body taken for a request is how requests are
// smuggled. Source: RFC 9112 (HTTP/1.1), sections 2 to 6.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>

#include "api/errors.h"
#include "server/http/message.h"

namespace kdray::server {

struct HeadLimits {
  std::size_t bytes = 32 * 1024;     ///< headers_too_large
  std::size_t uri_bytes = 8 * 1024;  ///< uri_too_long
  std::size_t fields = 64;           ///< headers_too_large
};

struct RequestHead {
  std::string method;
  std::string path, query_string;  ///< origin-form, percent-encoded as they came; an absolute-form
                                   ///< target is cut down to it
  HttpHeaders headers;               ///< values without the blanks around them
  std::uint64_t content_length = 0;  ///< saturates
  bool expects_continue = false;
  bool keep_alive = true;
};

/// What could be made out before the refusal comes along, for the log and for HEAD.
struct RefusedHead {
  RequestHead known;
  api::Problem problem;
};

/// `text` runs from the first byte to the end of the blank line, that included. Refuses with
/// malformed_request, uri_too_long, headers_too_large or length_required (any Transfer-Encoding).
/// Bodies belong to POST, PUT and PATCH only. O(bytes).
std::variant<RequestHead, RefusedHead> ParseRequestHead(std::string_view text,
                                                        const HeadLimits& limits);

/// Number of bytes up to and with the blank line that ends a head in `text`, or 0 when it has not
/// come yet. `from` is where the last look ended. A bare line feed ends lines here too, so that a
/// malformed head is complete and can be refused at once.
std::size_t FindHeadEnd(std::string_view text, std::size_t from);

}  // namespace kdray::server
