// SPDX-License-Identifier: Apache-2.0
#include "api/batch_codec.h"

#include <limits>
#include <utility>

#include "api/hit_encoder.h"
#include "api/json_batch.h"
#include "api/npy.h"

namespace kdray::api {
namespace {

double LargestT(const RayOptions& options) {
  return options.t_max.value_or(std::numeric_limits<double>::infinity());
}

NumberType NumbersOf(const RayTable& rays, const RayOptions& options) {
  return options.dtype.value_or(rays.number_type());
}

}  // namespace

Outcome<RayTable> DecodeRays(std::string_view body, BatchType type, const RayOptions& options,
                             const Limits& limits, const BatchWork& work) {
  if (body.size() > limits.MaxBatchBytes()) {
    Problem problem{ErrorCode::kBodyTooLarge, "the body has " + std::to_string(body.size()) +
                                                  " bytes; a batch has at most " +
                                                  std::to_string(limits.MaxBatchBytes())};
    problem.limit = static_cast<double>(limits.MaxBatchBytes());
    problem.actual = static_cast<double>(body.size());
    return problem;
  }
  const double t_max = LargestT(options);
  if (type == BatchType::kJson) {
    return ReadRayRows(body, options.t_min, t_max, limits.max_rays, work);
  }
  Outcome<NpyArray> array = ReadNpy(body);
  if (!array) return std::move(array).problem();
  return RayTable::FromNpy(*std::move(array), options.t_min, t_max, limits.max_rays);
}

std::vector<std::size_t> ArrivingRays::Shape() const {
  return {start.array.shape.begin(), start.array.shape.end() - 1};
}

std::optional<ArrivingRays> RecogniseRays(std::string_view start,
                                          std::optional<std::uint64_t> body_bytes,
                                          const RayOptions& options, const Limits& limits) {
  Outcome<NpyStart> array = ReadNpyStart(start);
  if (!array || array->array.fortran_order) return std::nullopt;
  const auto form = RayRowForm::Of(array->array, options.t_min, LargestT(options));
  if (!form || form->RayType() != form->sent) return std::nullopt;
  const std::uint64_t rows = array->data_bytes / form->RowBytes();
  if (rows > limits.max_rays) return std::nullopt;
  if (body_bytes && *body_bytes != array->header_bytes + array->data_bytes) return std::nullopt;
  return ArrivingRays{*std::move(array), *form, static_cast<std::size_t>(rows)};
}

std::unique_ptr<AnswerWriter<ClosestRows>> WriterOfClosest(const RayTable& rays,
                                                           const RayOptions& options,
                                                           BatchType type, ChargeBytes charge,
                                                           BlockSource* blocks) {
  return std::make_unique<AnswerWriter<ClosestRows>>(
      type, EncoderOfClosest(options.fields, NumbersOf(rays, options)), rays.shape(),
      std::move(charge), blocks);
}

std::unique_ptr<AnswerWriter<AnyRows>> WriterOfAny(const RayTable& rays, const RayOptions&,
                                                   BatchType type, ChargeBytes charge,
                                                   BlockSource* blocks) {
  return std::make_unique<AnswerWriter<AnyRows>>(type, EncoderOfAny(), rays.shape(),
                                                 std::move(charge), blocks);
}

std::unique_ptr<AnswerWriter<CountRows>> WriterOfCount(const RayTable& rays,
                                                       const RayOptions& options, BatchType type,
                                                       ChargeBytes charge, BlockSource* blocks) {
  return std::make_unique<AnswerWriter<CountRows>>(type, EncoderOfCount(NumbersOf(rays, options)),
                                                   rays.shape(), std::move(charge), blocks);
}

std::unique_ptr<AnswerWriter<AllRows>> WriterOfAll(const RayTable& rays, const RayOptions& options,
                                                   BatchType type, ChargeBytes charge,
                                                   BlockSource* blocks) {
  return std::make_unique<AnswerWriter<AllRows>>(
      type, EncoderOfAll(options.fields, NumbersOf(rays, options)), std::nullopt, std::move(charge),
      blocks);
}

std::string ImageHeader(const ImageArray& image) {
  const auto header = [&](const auto& values) {
    using Value = typename std::decay_t<decltype(values)>::value_type;
    std::vector<std::size_t> shape = {image.height, image.width};
    if (image.channels != 1) shape.push_back(image.channels);
    const std::string_view type = std::is_same_v<Value, float>    ? "'<f4'"
                                  : std::is_same_v<Value, double> ? "'<f8'"
                                                                  : "'<i4'";
    return NpyHeader(type, shape);
  };
  return std::visit(header, image.values);
}

std::string_view ImageBytes(const ImageArray& image) {
  return std::visit(
      [](const auto& values) {
        return std::string_view(reinterpret_cast<const char*>(values.data()),
                                values.size() * sizeof(values[0]));
      },
      image.values);
}

}  // namespace kdray::api
