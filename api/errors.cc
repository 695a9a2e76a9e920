// SPDX-License-Identifier: Apache-2.0
#include "api/errors.h"

#include <array>
#include <cassert>

namespace kdray::api {
namespace {

using enum ErrorCode;

constexpr std::array kTable = {
    ErrorRow{kInvalidJson, 400, "The body is not the JSON that was expected",
             "The text is not JSON (RFC 8259), has a number beyond the range of double, repeats a "
             "key, nests too deeply, or a value has the "
             "wrong kind. The detail says where."},
    ErrorRow{kInvalidArray, 400, "The body is not the .npy array that was expected",
             "The .npy header is invalid, the array has another type or shape than the query "
             "needs, or its size differs from the bytes sent. "
             "Send <f4 or <f8 of shape (..., 6) or (..., 8) for rays and (..., 3) for points."},
    ErrorRow{kInvalidParameter, 400, "A parameter is unknown or out of range",
             "A query parameter or JSON field is unknown, repeated, or has a value that is not "
             "allowed. The detail says what is allowed."},
    ErrorRow{kMalformedRequest, 400, "The request is not valid HTTP",
             "The request line, a header or a length is invalid, the chunks or the gzip or zstd "
             "stream of the body are damaged, or the request has a body that the path does not "
             "take."},
    ErrorRow{kUnauthorized, 401, "A valid token is needed",
             "Send 'Authorization: Bearer TOKEN' with a token of this server."},
    ErrorRow{kTreeNotFound, 404, "No tree has this id",
             "The tree was never built here, or it was deleted. Upload the mesh again: the same "
             "bytes give the same id."},
    ErrorRow{kMeshNotFound, 404, "No mesh has this SHA-256",
             "The server does not have these mesh bytes. Upload them with POST /v1/trees."},
    ErrorRow{kNotMeasured, 404, "Nothing has been measured for this tree",
             "Start the measurement with POST on the same path."},
    ErrorRow{kNotFound, 404, "This path does not exist", "GET /openapi.json lists the paths."},
    ErrorRow{kMethodNotAllowed, 405, "The path does not have this method",
             "The Allow header lists its methods."},
    ErrorRow{kNotAcceptable, 406, "The answer cannot have a type that Accept allows",
             "Accept may name application/json or application/x-npy for queries."},
    ErrorRow{kRequestTimeout, 408, "The request took too long to arrive",
             "The head or body of the request was not complete in time."},
    ErrorRow{kTreeBuilding, 409, "The tree is still being built",
             "Repeat the request after Retry-After seconds, or with a longer deadline_ms.", 1},
    ErrorRow{kLengthRequired, 411, "The body needs a Content-Length or chunks",
             "Of transfer codings only 'chunked' alone is accepted. Send it, or the length."},
    ErrorRow{kMeshTooLarge, 413, "The mesh is larger than this server accepts",
             "GET /v1 lists the limits."},
    ErrorRow{kTooManyRays, 413, "The batch has more rows than this server accepts",
             "Split the batch: an answer row does not depend on its neighbours."},
    ErrorRow{kTooManyHits, 413, "The answer has more hits than this server sends",
             "Send fewer rows, or a smaller max_hits. GET /v1 lists the limit as "
             "max_answer_hits."},
    ErrorRow{kTooManyCells, 413, "The tree has too many cells at this depth",
             "Use a smaller depth."},
    ErrorRow{kImageTooLarge, 413, "The image is larger than this server renders",
             "Render regions of it: put together they equal the whole."},
    ErrorRow{kBodyTooLarge, 413, "The body is larger than this path accepts",
             "GET /v1 lists the limits."},
    ErrorRow{kUriTooLong, 414, "The request line is too long",
             "Send the fields as a JSON object with POST."},
    ErrorRow{kUnsupportedMeshFormat, 415, "The bytes are in no supported mesh format",
             "The format is detected from the bytes alone. GET /v1 lists the formats."},
    ErrorRow{
        kUnsupportedMediaType, 415, "The body's Content-Type is not accepted here",
        "Send application/json, application/x-npy, application/octet-stream, or no Content-Type."},
    ErrorRow{kUnsupportedEncoding, 415, "The body's Content-Encoding is not accepted here",
             "Uploads may have Content-Encoding gzip or zstd, other bodies none."},
    ErrorRow{kInvalidMesh, 422, "The mesh file breaks the rules of its format",
             "The detail names the line or byte and the cause."},
    ErrorRow{kEmptyMesh, 422, "The mesh has no triangle",
             "The body is empty, or the file has no face with three corners."},
    ErrorRow{kHeadersTooLarge, 431, "The request's headers are too large",
             "Send fewer or shorter headers."},
    ErrorRow{kInternal, 500, "The server had an internal error",
             "Report it with the request_id; the log has the cause."},
    ErrorRow{kOverloaded, 503, "The server is at its limit of work",
             "Repeat the request after Retry-After seconds.", 1},
    ErrorRow{kDraining, 503, "The server is shutting down",
             "Use another server, or repeat the request after Retry-After seconds.", 5},
    ErrorRow{kMemoryFull, 503, "There is no memory for this now",
             "Repeat the request after Retry-After seconds.", 5},
    ErrorRow{kDeadlineExceeded, 504, "The answer was not ready within deadline_ms",
             "Request less, or use a longer deadline_ms."},
    ErrorRow{kStoreFull, 507, "The disk has no room for the mesh",
             "Delete trees that are no longer needed, or have the store enlarged."},
};

constexpr bool InEnumeratorOrder() {
  for (std::size_t i = 0; i < kTable.size(); ++i) {
    if (static_cast<std::size_t>(kTable[i].code) != i) return false;
  }
  return true;
}
static_assert(kTable.size() == kErrorCodeNames.size() && InEnumeratorOrder());

}  // namespace

std::span<const ErrorRow> ErrorTable() { return kTable; }

const ErrorRow& RowOf(ErrorCode code) {
  const auto index = static_cast<std::size_t>(code);
  assert(index < kTable.size());
  return kTable[index];
}

std::optional<ErrorCode> ParseErrorCode(std::string_view name) {
  for (const ErrorRow& row : kTable) {
    if (Name(row.code) == name) return row.code;
  }
  return std::nullopt;
}

}  // namespace kdray::api
