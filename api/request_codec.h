// SPDX-License-Identifier: Apache-2.0
// Decodes queries and small JSON bodies into request structs. `query` is the text after the '?' of
// the request line, as sent (empty if absent); it is decoded strictly (api/query_string.h).
//
// Every error names the parameter and what is allowed: invalid_parameter for parameters that are
// unknown, repeated, of the wrong kind, outside their range, or not in this version. For JSON
// bodies, invalid_json with the JSON pointer if the text or the kind of a value is wrong.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "api/limits.h"
#include "api/points.h"
#include "api/types.h"
#include "api/visibility.h"

namespace kdray::api {

Outcome<UploadRequest> DecodeUpload(std::string_view query, const Limits& limits);
Outcome<ListRequest> DecodeList(std::string_view query, const Limits& limits);
Outcome<DescribeRequest> DecodeDescribe(std::string_view query, const Limits& limits);
Outcome<MeasureRequest> DecodeMeasure(std::string_view query, const Limits& limits);
Outcome<CellsRequest> DecodeCells(std::string_view query, const Limits& limits);
Outcome<RayOptions> DecodeClosestOptions(std::string_view query, const Limits& limits);
Outcome<RayOptions> DecodeAnyOptions(std::string_view query, const Limits& limits);
Outcome<PointOptions> DecodeClosestPointOptions(std::string_view query, const Limits& limits);
/// signed-distance and inside
Outcome<PointOptions> DecodeSideOptions(std::string_view query, const Limits& limits);
/// invalid_parameter also for t_min > t_max, and for t_max beside to_directions.
Outcome<VisibilityOptions> DecodeVisibilityOptions(std::string_view query, const Limits& limits);
Outcome<RayOptions> DecodeCountOptions(std::string_view query, const Limits& limits);
Outcome<RayOptions> DecodeAllOptions(std::string_view query, const Limits& limits);

/// For paths that take no parameters.
Check CheckNoParameters(std::string_view query);

/// GET render.png and render.npy. image_too_large if the image, or the requested region, has more
/// pixels or a longer side than the limits allow. invalid_parameter also for a field that the mode,
/// the projection or the form does not use (api/field_use.h).
Outcome<RenderRequest> DecodeRenderQuery(std::string_view query, ImageForm form,
                                         const Limits& limits);
/// POST render.png and render.npy: the same fields as a JSON object. Also unsupported_media_type (a
/// Content-Type that names something other than JSON) and body_too_large.
Outcome<RenderRequest> DecodeRenderBody(std::string_view body, ImageForm form,
                                        std::optional<std::string_view> content_type,
                                        const Limits& limits);

/// The same text for parameters in any order, with or without defaults. Fields that do not affect
/// the answer's bytes (deadline_ms) are not included. For ETags.
std::string CanonicalQuery(const RenderRequest& request);
std::string CanonicalQuery(const CellsRequest& request);

}  // namespace kdray::api
