// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/answers.h"

#include <algorithm>
#include <array>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "api/names.h"
#include "core/base/hash.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;

constexpr std::size_t kBodyPieceBytes = std::size_t{64} << 10;

Problem BodyTooLarge(std::uint64_t max_bytes, std::optional<std::uint64_t> declared) {
  Problem problem{.code = ErrorCode::kBodyTooLarge,
                  .detail = "the body has " +
                            (declared ? std::to_string(*declared) : std::string("more")) +
                            " bytes, at most " + std::to_string(max_bytes) + " are taken here",
                  .limit = static_cast<double>(max_bytes)};
  if (declared) problem.actual = static_cast<double>(*declared);
  return problem;
}

std::string_view Trim(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

}  // namespace

api::Check CheckBody(const HandlerContext& context, const RoutedRequest& routed,
                     std::uint64_t max_bytes, const WorkOfBody& work) {
  const std::optional<std::uint64_t> declared = routed.http.peer->body_size();
  if (declared && *declared > max_bytes) return BodyTooLarge(max_bytes, declared);
  if (declared && work) {
    if (auto problem = context.admission.Check(LaneOf(work(*declared)))) return problem;
  }
  return context.memory.CheckBody(declared.value_or(0));
}

api::Outcome<std::size_t> ReadPiece(HttpPeer& peer, std::uint64_t max_bytes, std::uint64_t taken,
                                    std::span<std::byte> piece) {
  auto count = peer.ReadBody(piece);
  if (count && taken + *count > max_bytes) return BodyTooLarge(max_bytes, peer.body_size());
  return count;
}

api::Outcome<RequestBody> ReadWholeBody(const HandlerContext& context, const RoutedRequest& routed,
                                        std::uint64_t max_bytes, const WorkOfBody& work) {
  if (auto problem = CheckBody(context, routed, max_bytes, work)) return *std::move(problem);
  HttpPeer& peer = *routed.http.peer;
  RequestMemory::Body body(&context.memory);
  std::vector<std::byte> piece(
      std::min<std::uint64_t>(peer.body_size().value_or(max_bytes), kBodyPieceBytes));
  for (std::uint64_t taken = 0;;) {
    const auto count = ReadPiece(peer, max_bytes, taken, piece);
    if (!count) return count.problem();
    if (*count == 0) return body.Finish();
    taken += *count;
    if (auto problem = body.Append(std::span(piece).first(*count))) return *std::move(problem);
  }
}

api::Check RefuseBody(const RoutedRequest& routed) {
  HttpPeer& peer = *routed.http.peer;
  if (peer.body_size() == 0) return std::nullopt;
  if (!peer.body_size()) {  // only its first byte shows that a chunked body is not empty
    std::array<std::byte, 1> first;
    const auto count = peer.ReadBody(first);
    if (!count) return count.problem();
    if (*count == 0) return std::nullopt;
  }
  Problem problem{
      .code = ErrorCode::kMalformedRequest, .detail = "this request takes no body", .limit = 0.0};
  if (peer.body_size()) problem.actual = static_cast<double>(*peer.body_size());
  return problem;
}

void SetCaching(HttpResponse& response, const HandlerContext& context, Caching caching) {
  const std::string who = context.with_tokens ? "private" : "public";
  switch (caching) {
    case Caching::kForever:
      return response.headers.Set("Cache-Control", who + ", max-age=31536000, immutable");
    case Caching::kHour:
      return response.headers.Set("Cache-Control", who + ", max-age=3600");
    case Caching::kRevalidate:
      return response.headers.Set("Cache-Control", "no-cache");
    case Caching::kNever:
      return response.headers.Set("Cache-Control", "no-store");
  }
}

std::string MakeEtag(std::string_view what, std::string_view tree_id, std::string_view query) {
  std::string text = KDRAY_VERSION;
  for (const std::string_view part : {what, tree_id, query}) {
    text += '\n';
    text += part;
  }
  return Quoted(core::HashBytes(std::as_bytes(std::span(text))).ToHex().substr(0, 32));
}

std::string Quoted(std::string_view tag) {
  std::string etag(1, '"');
  etag += tag;
  etag += '"';
  return etag;
}

bool ClientHas(const HttpRequest& request, std::string_view etag) {
  std::string_view list = request.headers.Find("If-None-Match").value_or(std::string_view());
  while (!list.empty()) {
    const auto comma = list.find(',');  // our tags have no comma
    std::string_view tag = Trim(list.substr(0, comma));
    if (tag == "*") return true;
    // The comparison is weak: a cache that changed the coding still has our bytes.
    if (tag.starts_with("W/")) tag.remove_prefix(2);
    if (tag == etag) return true;
    list.remove_prefix(comma == std::string_view::npos ? list.size() : comma + 1);
  }
  return false;
}

HttpResponse NotModified(const HandlerContext& context, std::string_view etag, Caching caching) {
  HttpResponse response;
  response.status = 304;
  response.headers.Add("ETag", etag);
  SetCaching(response, context, caching);
  return response;
}

HttpResponse JsonAnswer(int status, std::string json) {
  HttpResponse response;
  response.status = status;
  response.body = std::move(json);
  response.headers.Add("Content-Type", "application/json");
  return response;
}

void AddBatchHeaders(HttpResponse& response, api::BatchType type, api::Precision precision,
                     std::size_t invalid) {
  response.headers.Add("Content-Type", api::ContentType(type));
  response.headers.Add("Vary", "Accept");
  response.headers.Add("Kdray-Precision", api::Name(precision));
  response.headers.Add("Kdray-Invalid", std::to_string(invalid));
}

}  // namespace kdray::server
