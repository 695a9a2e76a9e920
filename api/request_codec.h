// Queries and small JSON bodies into request structs. `query` is what stands behind the '?' of the
// request line, as sent (empty when there is none): it is decoded here, strictly
// (api/query_string.h).
//
// Every refusal names the parameter and says what there is: invalid_parameter for parameters that
// are unknown, given twice, of the wrong kind, outside their range, or not in this version. For
// JSON bodies invalid_json where the text or a value's kind is wrong, with the JSON pointer.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "api/limits.h"
#include "api/types.h"

namespace kdray::api {

Outcome<UploadRequest> DecodeUpload(std::string_view query, const Limits& limits);
Outcome<ListRequest> DecodeList(std::string_view query, const Limits& limits);
Outcome<DescribeRequest> DecodeDescribe(std::string_view query, const Limits& limits);
Outcome<MeasureRequest> DecodeMeasure(std::string_view query, const Limits& limits);
Outcome<CellsRequest> DecodeCells(std::string_view query, const Limits& limits);
Outcome<RayOptions> DecodeClosestOptions(std::string_view query, const Limits& limits);
Outcome<RayOptions> DecodeAnyOptions(std::string_view query, const Limits& limits);

/// For paths that take no parameters.
Check CheckNoParameters(std::string_view query);

/// GET render.png and render.npy. image_too_large when the image, or the region of it that is asked
/// for, has more pixels or a longer side than the limits say. invalid_parameter also for a field
/// that the mode, the projection or the form does not use (api/field_use.h).
Outcome<RenderRequest> DecodeRenderQuery(std::string_view query, ImageForm form,
                                         const Limits& limits);
/// POST render.png and render.npy: the same fields as a JSON object. Also unsupported_media_type (a
/// Content-Type that names something other than JSON) and body_too_large.
Outcome<RenderRequest> DecodeRenderBody(std::string_view body, ImageForm form,
                                        std::optional<std::string_view> content_type,
                                        const Limits& limits);

/// One text per request: the same for parameters in any order and for defaults left out or written.
/// What does not change the answer's bytes (deadline_ms) is not in it. For ETags.
std::string CanonicalQuery(const RenderRequest& request);
std::string CanonicalQuery(const CellsRequest& request);

}  // namespace kdray::api
