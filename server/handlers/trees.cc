// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/trees.h"

#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "api/answer_codec.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/upload_body.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using api::Problem;

constexpr std::size_t kUploadPieceBytes = 256 * 1024;

/// Service has refused the other codings.
std::optional<ContentCoding> UploadCoding(const HttpRequest& request) {
  return ParseContentCoding(request.headers.Find("Content-Encoding").value_or(std::string_view()));
}

/// Streams the mesh from the connection to the store. Errors that do not depend on its bytes come
/// before the first byte.
api::Outcome<MeshUpload::Stored> StoreBody(const HandlerContext& context,
                                           const RoutedRequest& routed, api::Build build) {
  HttpPeer& peer = *routed.http.peer;
  const Problem empty{.code = ErrorCode::kEmptyMesh, .detail = "the body is empty"};
  if (peer.body_size() == 0) return empty;
  UploadBody body(&peer, &context.memory, UploadCoding(routed.http),
                  context.limits.max_upload_bytes);
  if (auto problem = body.CheckDeclared()) return *std::move(problem);

  auto upload = context.backend.BeginUpload(body.least_bytes());
  if (!upload) return std::move(upload).problem();
  std::vector<std::byte> piece(kUploadPieceBytes);
  for (bool is_empty = true;; is_empty = false) {
    const auto count = body.Read(piece);
    if (!count) return count.problem();
    if (*count == 0) return is_empty ? empty : (*upload)->Finish(build);
    if (auto problem = (*upload)->Append(std::span(piece).first(*count))) {
      return *std::move(problem);
    }
  }
}

api::Outcome<MeshUpload::Stored> Store(const HandlerContext& context, const RoutedRequest& routed,
                                       const api::UploadRequest& request) {
  if (!request.mesh) return StoreBody(context, routed, request.build);
  if (auto problem = RefuseBody(routed)) return *std::move(problem);
  return context.backend.BuildStored(*request.mesh, request.build);
}

/// Describes the tree when it is built, or after the client's wait_ms.
api::Outcome<api::TreeDescription> DescribeWithin(const HandlerContext& context,
                                                  const RoutedRequest& routed, std::string_view id,
                                                  std::int64_t wait_ms) {
  const auto now = std::chrono::steady_clock::now();
  if (wait_ms == 0) return context.backend.Describe(id, now, CancelToken());
  const auto cancel = CancelToken::Cancellable();
  const auto watch = routed.http.peer->CancelWhenGone(cancel);
  return context.backend.Describe(id, now + std::chrono::milliseconds(wait_ms), cancel);
}

}  // namespace

api::Outcome<HttpResponse> PostTree(const HandlerContext& context, RoutedRequest& routed) {
  const auto request = api::DecodeUpload(routed.http.query_string, context.limits);
  if (!request) return request.problem();

  const Stopwatch receiving;
  const auto stored = Store(context, routed, *request);
  if (!stored) return stored.problem();
  routed.timing.parse_ms = receiving.ms();

  const auto tree = DescribeWithin(context, routed, stored->id, request->wait_ms);
  if (!tree) return tree.problem();
  if (!stored->existed && tree->tree) {
    *routed.timing.parse_ms += tree->tree->parse_ms;
    routed.timing.build_ms = tree->tree->build_ms;
  }
  const int status = !tree->ready ? 202 : stored->existed ? 200 : 201;
  HttpResponse response = JsonAnswer(status, api::EncodeDescription(*tree));
  if (status != 200) response.headers.Add("Location", "/v1/trees/" + stored->id);
  SetCaching(response, context, Caching::kNever);
  return response;
}

api::Outcome<HttpResponse> ListTrees(const HandlerContext& context, RoutedRequest& routed) {
  const auto request = api::DecodeList(routed.http.query_string, context.limits);
  if (!request) return request.problem();
  const auto page =
      context.backend.List(request->mesh, static_cast<std::size_t>(request->limit), request->after);
  if (!page) return page.problem();
  HttpResponse response = JsonAnswer(200, api::EncodePage(*page));
  SetCaching(response, context, Caching::kRevalidate);
  return response;
}

api::Outcome<HttpResponse> GetTree(const HandlerContext& context, RoutedRequest& routed) {
  const auto request = api::DecodeDescribe(routed.http.query_string, context.limits);
  if (!request) return request.problem();
  const auto tree = DescribeWithin(context, routed, routed.path_parameter, request->wait_ms);
  if (!tree) return tree.problem();
  HttpResponse response = JsonAnswer(200, api::EncodeDescription(*tree));
  SetCaching(response, context, Caching::kRevalidate);
  return response;
}

api::Outcome<HttpResponse> DeleteTree(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  if (auto problem = context.backend.Delete(routed.path_parameter)) return *std::move(problem);
  HttpResponse response;
  response.status = 204;
  SetCaching(response, context, Caching::kNever);
  return response;
}

api::Outcome<HttpResponse> GetMesh(const HandlerContext& context, RoutedRequest& routed) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) return *std::move(problem);
  if (auto problem = context.backend.Find(routed.path_parameter)) return *std::move(problem);
  // The id begins with the hash of these bytes.
  const std::string etag = Quoted(routed.path_parameter.substr(0, routed.path_parameter.find('-')));
  if (ClientHas(routed.http, etag)) return NotModified(context, etag, Caching::kForever);
  const auto cancel = CancelToken::Cancellable();
  const auto watch = routed.http.peer->CancelWhenGone(cancel);
  auto opened = context.backend.OpenMesh(routed.path_parameter, cancel);
  if (!opened) return std::move(opened).problem();

  const std::shared_ptr<MeshBytes> mesh = *std::move(opened);
  HttpResponse response;
  response.body = HttpBody::Streamed(
      mesh->size(),
      [mesh](std::uint64_t offset, std::span<std::byte> out) { return mesh->Read(offset, out); });
  response.headers.Add("Content-Type", "application/octet-stream");
  response.headers.Add("ETag", etag);
  SetCaching(response, context, Caching::kForever);
  return response;
}

}  // namespace kdray::server
