// SPDX-License-Identifier: Apache-2.0
// Shared by handlers: reading bodies, and the headers for caching.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "api/batch_type.h"
#include "api/types.h"
#include "server/handler.h"
#include "server/handlers/request_cost.h"

namespace kdray::server {

/// A body in memory, with its charge of request memory.
using RequestBody = RequestMemory::Body::Whole;

/// body_too_large beyond `max_bytes`, memory_full, overloaded, or the problem of the peer's
/// ReadBody(). The body is charged as its bytes arrive. If there is no memory now for a declared
/// length, or no place in the queue of its work, the request fails before a byte is read. A chunked
/// body fails at its first byte beyond `max_bytes`. Without `work`, no queue is looked at.
api::Outcome<RequestBody> ReadWholeBody(const HandlerContext& context, const RoutedRequest& routed,
                                        std::uint64_t max_bytes, const WorkOfBody& work);

// The two halves of ReadWholeBody(), for a body that is decoded while it arrives.

/// body_too_large, memory_full or overloaded, before a byte is read.
api::Check CheckBody(const HandlerContext& context, const RoutedRequest& routed,
                     std::uint64_t max_bytes, const WorkOfBody& work);
/// Reads at most `piece` of a body of which `taken` bytes have been read. Returns the number of
/// bytes, 0 at its end; body_too_large beyond `max_bytes`.
api::Outcome<std::size_t> ReadPiece(HttpPeer& peer, std::uint64_t max_bytes, std::uint64_t taken,
                                    std::span<std::byte> piece);

/// For requests without a body whose method allows one: malformed_request if there is a body.
api::Check RefuseBody(const RoutedRequest& routed);

/// How long, and by whom, an answer may be cached.
enum class Caching : std::uint8_t {
  kForever,     ///< the bytes of this path never change
  kHour,        ///< the same, but a new version may compute other bytes
  kRevalidate,  ///< must be revalidated each time
  kNever,
};
void SetCaching(HttpResponse& response, const HandlerContext& context, Caching caching);

/// A strong validator, quoted, of everything that determines the answer's bytes, and the version.
std::string MakeEtag(std::string_view what, std::string_view tree_id, std::string_view query);

/// `tag` as a strong validator.
std::string Quoted(std::string_view tag);

/// True when If-None-Match names `etag` or is `*` (RFC 9110, 13.1.2).
bool ClientHas(const HttpRequest& request, std::string_view etag);

/// 304: the client's copy is still valid.
HttpResponse NotModified(const HandlerContext& context, std::string_view etag, Caching caching);

HttpResponse JsonAnswer(int status, std::string json);

/// The headers of every batch's answer: its form, the precision that was used, and the number of
/// invalid rows.
void AddBatchHeaders(HttpResponse& response, api::BatchType type, api::Precision precision,
                     std::size_t invalid);

}  // namespace kdray::server
