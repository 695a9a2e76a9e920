#include "api/batch_codec.h"

#include <limits>
#include <utility>

#include "api/closest_encoder.h"
#include "api/json_batch.h"
#include "api/json_text.h"
#include "api/npy.h"
#include "api/npy_batch.h"

namespace kdray::api {

Outcome<RayTable> DecodeRays(std::string_view body, BatchType type, const RayOptions& options,
                             const Limits& limits, const ShouldStop& should_stop) {
  if (body.size() > limits.MaxBatchBytes()) {
    Problem problem{ErrorCode::kBodyTooLarge, "the body has " + std::to_string(body.size()) +
                                                  " bytes; a batch has at most " +
                                                  std::to_string(limits.MaxBatchBytes())};
    problem.limit = static_cast<double>(limits.MaxBatchBytes());
    problem.actual = static_cast<double>(body.size());
    return problem;
  }
  const double t_max = options.t_max.value_or(std::numeric_limits<double>::infinity());
  if (type == BatchType::kNpy) {
    const Outcome<NpyArray> array = ReadNpy(body);
    if (!array) return array.problem();
    return RaysFromNpy(*array, options.t_min, t_max, limits.max_rays, should_stop);
  }
  Outcome<std::vector<RayRow<double>>> rows =
      ReadRayRows(body, options.t_min, t_max, limits.max_rays, should_stop);
  if (!rows) return std::move(rows).problem();
  return RayTable{{rows->size()}, *std::move(rows), NumberType::kF8};
}

std::string EncodeClosest(const ClosestAnswer& answer, const RayTable& rays,
                          const RayOptions& options, BatchType type,
                          const ShouldStop& should_stop) {
  const NumberType numbers = options.dtype.value_or(rays.number_type());
  return type == BatchType::kJson
             ? ClosestAsJson(answer, options.fields, numbers, should_stop)
             : ClosestAsNpy(answer, options.fields, numbers, rays.shape, should_stop);
}

std::string EncodeAny(const AnyAnswer& answer, const RayTable& rays, BatchType type,
                      const ShouldStop& should_stop) {
  StopPoll poll(should_stop);
  if (type == BatchType::kNpy) {
    std::string out = NpyHeader("'|b1'", rays.shape);
    out.reserve(out.size() + answer.occluded.size());
    for (const std::uint8_t occluded : answer.occluded) {
      if (poll.Row()) return {};
      out += occluded ? '\1' : '\0';
    }
    return out;
  }
  std::string out = "{\"results\":[";
  for (std::size_t row = 0; row < answer.occluded.size(); ++row) {
    if (poll.Row()) return {};
    if (row != 0) out += ',';
    out += answer.occluded[row] ? "true" : "false";
  }
  out += "],";
  AppendRowLists(&out, answer.invalid);
  out += '}';
  return out;
}

std::string EncodeImage(const ImageArray& image) {
  const auto encode = [&](const auto& values) {
    using Value = typename std::decay_t<decltype(values)>::value_type;
    std::vector<std::size_t> shape = {image.height, image.width};
    if (image.channels != 1) shape.push_back(image.channels);
    const std::string_view type = std::is_same_v<Value, float>    ? "'<f4'"
                                  : std::is_same_v<Value, double> ? "'<f8'"
                                                                  : "'<i4'";
    std::string out = NpyHeader(type, shape);
    return out.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value));
  };
  return std::visit(encode, image.values);
}

}  // namespace kdray::api
