// SPDX-License-Identifier: Apache-2.0
// Decodes batches of rays, and makes the writers of their answers, as JSON or .npy.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "api/answer_writer.h"
#include "api/batch_type.h"
#include "api/batch_work.h"
#include "api/byte_block.h"
#include "api/limits.h"
#include "api/npy.h"
#include "api/ray_table.h"
#include "api/types.h"

namespace kdray::api {

/// Reads `{"rays": [[…],…]}` or a .npy array of shape (…, 6) or (…, 8). Rows of 6 get their
/// interval from `options`. invalid_json (with the JSON pointer, and the line), invalid_array,
/// too_many_rays, body_too_large. Rows are not checked: the backend lists invalid ones in
/// `invalid`. A table of .npy rows reads them in `body`, which must outlive it; JSON rows are in
/// memory. Once `work.should_stop` has returned true, any problem comes back.
Outcome<RayTable> DecodeRays(std::string_view body, BatchType type, const RayOptions& options,
                             const Limits& limits, const BatchWork& work = {});

/// An array of rays whose rows can be decoded while they arrive.
struct ArrivingRays {
  NpyStart start;
  RayRowForm form;
  std::size_t rows = 0;

  /// The leading shape.
  std::vector<std::size_t> Shape() const;
};

/// What a body that begins with `start` brings; `body_bytes` is its declared length, if there is
/// one. nullopt unless its rows can be decoded in order to rays of the same number type, and are
/// not too many, and the length is right. Then DecodeRays() takes the whole body, or says what is
/// wrong.
std::optional<ArrivingRays> RecogniseRays(std::string_view start,
                                          std::optional<std::uint64_t> body_bytes,
                                          const RayOptions& options, const Limits& limits);

// The writers of the answers to `rays`, which gives the leading shape and the default `dtype`.
// npy: one field is a plain array, several a packed structured one; numbers `<f4`/`<i4` or
// `<f8`/`<i8`; a miss has triangle -1 and t inf, an invalid row t NaN. JSON: `null` for both, and
// `invalid` lists the rows. Large pieces of .npy are taken from `blocks`, if it is not null.

std::unique_ptr<AnswerWriter<ClosestRows>> WriterOfClosest(const RayTable& rays,
                                                           const RayOptions& options,
                                                           BatchType type, ChargeBytes charge = {},
                                                           BlockSource* blocks = nullptr);
/// npy `|b1`, JSON booleans.
std::unique_ptr<AnswerWriter<AnyRows>> WriterOfAny(const RayTable& rays, const RayOptions& options,
                                                   BatchType type, ChargeBytes charge = {},
                                                   BlockSource* blocks = nullptr);
/// npy `<u4` or `<u8`, JSON numbers.
std::unique_ptr<AnswerWriter<CountRows>> WriterOfCount(const RayTable& rays,
                                                       const RayOptions& options, BatchType type,
                                                       ChargeBytes charge = {},
                                                       BlockSource* blocks = nullptr);
/// npy: one flat structured array of all hits, with the column `ray` (the row's number) in front;
/// JSON: a list of hits per row.
std::unique_ptr<AnswerWriter<AllRows>> WriterOfAll(const RayTable& rays, const RayOptions& options,
                                                   BatchType type, ChargeBytes charge = {},
                                                   BlockSource* blocks = nullptr);

/// What stands before the values of render.npy: (H, W) or (H, W, channels), `<f4`, `<f8` or `<i4`,
/// C order.
std::string ImageHeader(const ImageArray& image);
/// The values as they lie in memory, which is as they are sent.
std::string_view ImageBytes(const ImageArray& image);

}  // namespace kdray::api
