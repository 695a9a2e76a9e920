// What handlers share: reading bodies, and the headers of answers that say how long they keep.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "server/handler.h"

namespace kdray::server {

/// A body in memory, with its share of the memory of requests.
using RequestBody = RequestMemory::Body::Whole;

/// body_too_large beyond `max_bytes`, memory_full, or what ReadBody() of the peer says. Takes
/// several times the body, for what is made from it (rows in memory, the answer), as its bytes
/// arrive. A declared length for which there is no memory now is refused before a byte is read.
api::Outcome<RequestBody> ReadWholeBody(const HandlerContext& context, const RoutedRequest& routed,
                                        std::uint64_t max_bytes);

/// For requests that take no body although their method does: malformed_request when there is one.
api::Check RefuseBody(const RoutedRequest& routed);

/// How long, and by whom, an answer may be kept.
enum class Caching : std::uint8_t {
  kForever,     ///< the bytes behind this path never change
  kHour,        ///< nor do they here, but a new version may compute them anew
  kRevalidate,  ///< ask each time
  kNever,
};
void SetCaching(HttpResponse& response, const HandlerContext& context, Caching caching);

/// A strong validator, quoted, over all that the answer's bytes depend on. The version is added
/// here.
std::string MakeEtag(std::string_view what, std::string_view tree_id, std::string_view query);

/// `tag` as a strong validator.
std::string Quoted(std::string_view tag);

/// True when If-None-Match names `etag` or is `*` (RFC 9110, 13.1.2).
bool ClientHas(const HttpRequest& request, std::string_view etag);

/// 304: what the client has still holds.
HttpResponse NotModified(const HandlerContext& context, std::string_view etag, Caching caching);

HttpResponse JsonAnswer(int status, std::string json);

}  // namespace kdray::server
