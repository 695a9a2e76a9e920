#include "api/closest_encoder.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

#include "api/json_text.h"
#include "api/names.h"
#include "api/npy.h"

namespace kdray::api {
namespace {

static_assert(std::endian::native == std::endian::little,
              ".npy elements are written as they are; a big-endian machine has to swap them");

/// `number` in T, never -0.
template <class T>
T Narrow(double value) {
  if constexpr (std::is_same_v<T, float>) {
    constexpr double kMost = static_cast<double>(std::numeric_limits<float>::max());
    if (std::isfinite(value)) value = std::clamp(value, -kMost, kMost);
  }
  return static_cast<T>(value) + T{0};
}

/// The t of a hit: a hit never looks like a miss.
template <class T>
T NarrowT(const RayHit& hit) {
  constexpr double kMost = std::numeric_limits<double>::max();
  return Narrow<T>(hit.triangle < 0 ? hit.t : std::clamp(hit.t, -kMost, kMost));
}

bool IsVector(RayField field) { return field == RayField::kNormal || field == RayField::kPoint; }

// ---- JSON ----

template <class T>
void AppendVector(std::string* out, const auto& vector) {
  *out += '[';
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (axis != 0) *out += ',';
    AppendNumber(out, Narrow<T>(static_cast<double>(vector[axis])));
  }
  *out += ']';
}

template <class T>
void AppendField(std::string* out, const ClosestAnswer& answer, std::size_t row, RayField field) {
  const RayHit& hit = answer.hits[row];
  switch (field) {
    case RayField::kT:
      return AppendNumber(out, NarrowT<T>(hit));
    case RayField::kTriangle:
      return AppendInteger(out, hit.triangle);
    case RayField::kU:
      return AppendNumber(out, Narrow<T>(hit.u));
    case RayField::kV:
      return AppendNumber(out, Narrow<T>(hit.v));
    case RayField::kNormal:
      return AppendVector<T>(out, answer.normals[row]);
    case RayField::kPoint:
      return AppendVector<T>(out, answer.points[row]);
  }
}

template <class T>
std::string Json(const ClosestAnswer& answer, const std::vector<RayField>& fields, StopPoll* poll) {
  std::string out = "{\"results\":[";
  for (std::size_t row = 0; row < answer.hits.size(); ++row) {
    if (poll->Row()) return {};
    if (row != 0) out += ',';
    if (answer.hits[row].triangle < 0) {
      out += "null";
      continue;
    }
    char before = '{';
    for (const RayField field : fields) {
      out += before;
      out += '"';
      out += Name(field);
      out += "\":";
      AppendField<T>(&out, answer, row, field);
      before = ',';
    }
    out += '}';
  }
  out += "],";
  AppendRowLists(&out, answer.invalid);
  out += '}';
  return out;
}

// ---- npy ----

/// The type of one field as a Python literal, e.g. `'<f4'`.
std::string_view Descr(RayField field, NumberType numbers) {
  const bool wide = numbers == NumberType::kF8;
  if (field == RayField::kTriangle) return wide ? "'<i8'" : "'<i4'";
  return wide ? "'<f8'" : "'<f4'";
}

std::string StructuredDescr(const std::vector<RayField>& fields, NumberType numbers) {
  std::string descr = "[";
  for (const RayField field : fields) {
    if (descr.size() > 1) descr += ", ";
    descr += "('";
    descr += Name(field);
    descr += "', ";
    descr += Descr(field, numbers);
    descr += IsVector(field) ? ", (3,))" : ")";
  }
  return descr + "]";
}

template <class T>
char* Put(char* at, T value) {
  std::memcpy(at, &value, sizeof(T));
  return at + sizeof(T);
}

template <class T>
char* PutVector(char* at, const auto& vector) {
  for (const auto number : vector) at = Put(at, Narrow<T>(static_cast<double>(number)));
  return at;
}

template <class T>
char* PutField(char* at, const ClosestAnswer& answer, std::size_t row, RayField field) {
  using Integer = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
  const RayHit& hit = answer.hits[row];
  switch (field) {
    case RayField::kT:
      return Put(at, NarrowT<T>(hit));
    case RayField::kTriangle:
      // No accepted upload has 2^31 triangles, so <i4 represents every number.
      return Put(at, static_cast<Integer>(hit.triangle));
    case RayField::kU:
      return Put(at, Narrow<T>(hit.u));
    case RayField::kV:
      return Put(at, Narrow<T>(hit.v));
    case RayField::kNormal:
      return PutVector<T>(at, answer.normals[row]);
    case RayField::kPoint:
      return PutVector<T>(at, answer.points[row]);
  }
  return at;
}

template <class T>
void AppendRows(std::string* out, const ClosestAnswer& answer, const std::vector<RayField>& fields,
                StopPoll* poll) {
  std::size_t row_bytes = 0;
  for (const RayField field : fields) row_bytes += sizeof(T) * (IsVector(field) ? 3 : 1);
  const std::size_t header_bytes = out->size();
  out->resize(header_bytes + answer.hits.size() * row_bytes);
  char* at = out->data() + header_bytes;
  for (std::size_t row = 0; row < answer.hits.size() && !poll->Row(); ++row) {
    for (const RayField field : fields) at = PutField<T>(at, answer, row, field);
  }
}

[[maybe_unused]] bool HasColumns(const ClosestAnswer& answer, const std::vector<RayField>& fields) {
  const std::size_t rows = answer.hits.size();
  return std::all_of(fields.begin(), fields.end(), [&](RayField field) {
    return field == RayField::kNormal  ? answer.normals.size() == rows
           : field == RayField::kPoint ? answer.points.size() == rows
                                       : true;
  });
}

}  // namespace

std::string ClosestAsJson(const ClosestAnswer& answer, const std::vector<RayField>& fields,
                          NumberType numbers, const ShouldStop& should_stop) {
  assert(HasColumns(answer, fields));
  StopPoll poll(should_stop);
  return numbers == NumberType::kF4 ? Json<float>(answer, fields, &poll)
                                    : Json<double>(answer, fields, &poll);
}

std::string ClosestAsNpy(const ClosestAnswer& answer, const std::vector<RayField>& fields,
                         NumberType numbers, const std::vector<std::size_t>& leading_shape,
                         const ShouldStop& should_stop) {
  assert(HasColumns(answer, fields));
  std::vector<std::size_t> shape = leading_shape;
  std::string descr;
  if (fields.size() == 1) {
    descr = Descr(fields[0], numbers);
    if (IsVector(fields[0])) shape.push_back(3);
  } else {
    descr = StructuredDescr(fields, numbers);
  }
  std::string out = NpyHeader(descr, shape);
  StopPoll poll(should_stop);
  if (numbers == NumberType::kF4) {
    AppendRows<float>(&out, answer, fields, &poll);
  } else {
    AppendRows<double>(&out, answer, fields, &poll);
  }
  return poll.stopped() ? std::string() : out;
}

}  // namespace kdray::api
