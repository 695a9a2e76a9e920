#include "api/errors.h"

#include <array>
#include <cassert>

namespace kdray::api {
namespace {

using enum ErrorCode;

constexpr std::array kTable = {
    ErrorRow{kInvalidJson, 400, "The body is not the JSON that was expected",
             "The text is not JSON (RFC 8259), holds a number that double cannot hold, repeats a "
             "key, nests too deeply, or a value has the "
             "wrong kind. The detail names the place."},
    ErrorRow{kInvalidArray, 400, "The body is not the .npy array that was expected",
             "The .npy header is damaged, the array has another type or shape than the query "
             "takes, or its size does not fit the bytes sent. "
             "Send <f4 or <f8 of shape (..., 6) or (..., 8) for rays and (..., 3) for points."},
    ErrorRow{kInvalidParameter, 400, "A parameter is unknown or out of range",
             "A query parameter or JSON field is unknown, given twice, or has a value that is not "
             "allowed. The detail names what there is."},
    ErrorRow{kMalformedRequest, 400, "The request is not proper HTTP",
             "The request line, a length, or the compressed stream is damaged, or a body came "
             "where none belongs."},
    ErrorRow{kUnauthorized, 401, "A valid token is needed",
             "This server wants 'Authorization: Bearer TOKEN' with a token that it knows."},
    ErrorRow{kTreeNotFound, 404, "No tree has this id",
             "The id was never made here, or the tree was deleted. Upload the mesh again: the same "
             "bytes give the same id."},
    ErrorRow{kMeshNotFound, 404, "No mesh has this SHA-256",
             "The server does not hold these mesh bytes. Upload them with POST /v1/trees."},
    ErrorRow{kNotMeasured, 404, "Nothing has been measured for this tree",
             "Start the measurement with POST on the same path."},
    ErrorRow{kNotFound, 404, "There is nothing at this path",
             "GET /openapi.json lists the paths there are."},
    ErrorRow{kMethodNotAllowed, 405, "The path does not take this method",
             "The Allow header lists the methods it takes."},
    ErrorRow{kNotAcceptable, 406, "The answer cannot have the type that Accept asks for",
             "Accept may name application/json or application/x-npy for queries."},
    ErrorRow{kRequestTimeout, 408, "The request took too long to arrive",
             "The head or body of the request was not complete in time."},
    ErrorRow{
        kTreeBuilding, 409, "The tree is still being built",
        "Ask again after Retry-After seconds, or give a longer deadline_ms and the query waits.",
        1},
    ErrorRow{kLengthRequired, 411, "The body needs a Content-Length",
             "Chunked bodies are not taken. Send the length."},
    ErrorRow{kMeshTooLarge, 413, "The mesh is larger than this server takes",
             "The limit counts bytes after Content-Encoding is undone. GET /v1 tells the limits."},
    ErrorRow{kTooManyRays, 413, "The batch has more rows than this server takes",
             "Split the batch: an answer row does not depend on its neighbours."},
    ErrorRow{kTooManyHits, 413, "More hits a ray were asked for than this server gives",
             "GET /v1 tells the limits."},
    ErrorRow{kTooManyCells, 413, "The tree has too many cells at this depth",
             "Ask for a smaller depth."},
    ErrorRow{kImageTooLarge, 413, "The image is larger than this server renders",
             "Render regions of it: put together they equal the whole."},
    ErrorRow{kBodyTooLarge, 413, "The body is larger than this path takes",
             "GET /v1 tells the limits."},
    ErrorRow{kUriTooLong, 414, "The request line is too long",
             "Send the fields as a JSON object with POST."},
    ErrorRow{kUnsupportedMeshFormat, 415, "The bytes are of no mesh format that is read here",
             "The format is found from the bytes alone. GET /v1 lists the formats."},
    ErrorRow{
        kUnsupportedMediaType, 415, "The body's Content-Type is not taken here",
        "Send application/json, application/x-npy, application/octet-stream, or no Content-Type."},
    ErrorRow{kUnsupportedEncoding, 415, "The body's Content-Encoding is not taken here",
             "Send the body as it is."},
    ErrorRow{kInvalidMesh, 422, "The mesh file breaks the rules of its format",
             "The detail names the line or byte and the cause."},
    ErrorRow{kEmptyMesh, 422, "The mesh has no triangle",
             "The body is empty, or the file holds no face with three corners."},
    ErrorRow{kHeadersTooLarge, 431, "The request's headers are too large",
             "Send fewer or shorter headers."},
    ErrorRow{kInternal, 500, "The server made a mistake",
             "Report it with the request_id; the log has the cause."},
    ErrorRow{kOverloaded, 503, "The server has as much work as it can take",
             "Ask again after Retry-After seconds.", 1},
    ErrorRow{kDraining, 503, "The server is shutting down",
             "Ask another one, or again after Retry-After seconds.", 5},
    ErrorRow{kMemoryFull, 503, "There is no memory for this now",
             "Ask again after Retry-After seconds.", 5},
    ErrorRow{kDeadlineExceeded, 504, "The answer was not ready within deadline_ms",
             "Ask for less, or give a longer deadline_ms."},
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
