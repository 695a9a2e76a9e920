// Decodes batches of rays and encodes their answers, as JSON or .npy.
#pragma once

#include <string>
#include <string_view>

#include "api/batch_type.h"
#include "api/limits.h"
#include "api/should_stop.h"
#include "api/types.h"

namespace kdray::api {

// Large batches take seconds to read and to write. Once `should_stop` has said yes, DecodeRays ends
// with any problem, and an Encode function with an empty string.

/// Reads `{"rays": [[…],…]}` or a .npy array of shape (…, 6) or (…, 8). Rows of 6 get their
/// interval from `options`. invalid_json (with the JSON pointer, and the line), invalid_array,
/// too_many_rays, body_too_large. Rows are not checked: the backend lists invalid ones in
/// `invalid`. Memory: the rows, no copy of the body.
Outcome<RayTable> DecodeRays(std::string_view body, BatchType type, const RayOptions& options,
                             const Limits& limits, const ShouldStop& should_stop = {});

/// The answer of rays/closest. `rays` gives the leading shape and the default `dtype`, `options`
/// the fields in their order. npy: one field is a plain array, several a packed structured one;
/// numbers `<f4`/`<i4` or `<f8`/`<i8`; a miss has triangle -1 and t inf, an invalid row t NaN.
/// JSON: `null` for both, and `invalid` lists the rows.
std::string EncodeClosest(const ClosestAnswer& answer, const RayTable& rays,
                          const RayOptions& options, BatchType type,
                          const ShouldStop& should_stop = {});

/// The answer of rays/any: npy `|b1`, JSON booleans.
std::string EncodeAny(const AnyAnswer& answer, const RayTable& rays, BatchType type,
                      const ShouldStop& should_stop = {});

/// render.npy: (H, W) or (H, W, channels), `<f4` or `<i4`, C order.
std::string EncodeImage(const ImageArray& image);

}  // namespace kdray::api
