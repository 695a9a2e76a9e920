// SPDX-License-Identifier: Apache-2.0
#include "api/point_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>

#include "api/json_row_reader.h"
#include "api/json_text.h"
#include "api/names.h"
#include "api/npy.h"

namespace kdray::api {
namespace {

static_assert(std::endian::native == std::endian::little,
              ".npy elements are read and written as they are; a big-endian machine has to swap");

// ---- Decoding ----

constexpr std::array<std::string_view, 1> kKeys = {"points"};
constexpr RowForm kPoints = {
    kKeys, "3 numbers (x y z)", {3, 3}, std::nullopt, ErrorCode::kTooManyRays};

Check CheckSize(std::string_view body, const Limits& limits) {
  if (body.size() <= limits.MaxBatchBytes()) return std::nullopt;
  Problem problem{ErrorCode::kBodyTooLarge, "the body has " + std::to_string(body.size()) +
                                                " bytes; a batch has at most " +
                                                std::to_string(limits.MaxBatchBytes())};
  problem.limit = static_cast<double>(limits.MaxBatchBytes());
  problem.actual = static_cast<double>(body.size());
  return problem;
}

Problem TooMany(std::string_view has, std::uint64_t actual, std::uint64_t limit) {
  Problem problem{ErrorCode::kTooManyRays, std::string(has) + std::to_string(actual) +
                                               "; at most " + std::to_string(limit) +
                                               " are allowed"};
  problem.limit = static_cast<double>(limit);
  problem.actual = static_cast<double>(actual);
  return problem;
}

/// The number of a row in Fortran order, the order of its elements in memory. Rows come in C order.
class FortranPlace {
 public:
  explicit FortranPlace(std::span<const std::size_t> shape)
      : shape_(shape.begin(), shape.end()), index_(shape.size()), stride_(shape.size(), 1) {
    for (std::size_t d = 1; d < shape_.size(); ++d) stride_[d] = stride_[d - 1] * shape_[d - 1];
  }
  std::size_t place() const { return place_; }
  void Next() {
    for (std::size_t d = shape_.size(); d-- > 0;) {
      place_ += stride_[d];
      if (++index_[d] < shape_[d]) return;
      place_ -= stride_[d] * shape_[d];
      index_[d] = 0;
    }
  }

 private:
  std::vector<std::size_t> shape_, index_, stride_;
  std::size_t place_ = 0;
};

/// All rows of an array whose last dimension is 3. Some are missing once the poll has stopped.
template <class Sent>
std::vector<Vec3> RowsOf(const NpyArray& array, std::size_t rows, StopPoll* poll) {
  std::vector<Vec3> out;
  out.reserve(rows);
  FortranPlace fortran(std::span(array.shape).first(array.shape.size() - 1));
  for (std::size_t row = 0; row < rows && !poll->Row(); ++row) {
    Vec3 point;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      // The elements are not aligned, so they are copied.
      const std::size_t element =
          array.fortran_order ? axis * rows + fortran.place() : row * 3 + axis;
      Sent number;
      std::memcpy(&number, array.data.data() + element * sizeof(Sent), sizeof(Sent));
      point[axis] = static_cast<double>(number);
    }
    out.push_back(point);
    if (array.fortran_order) fortran.Next();
  }
  return out;
}

// ---- Encoding ----

/// `number` in T, never -0. A finite one stays finite.
template <class T>
T Narrow(double value) {
  constexpr double kMost = static_cast<double>(std::numeric_limits<T>::max());
  if (std::isfinite(value)) value = std::clamp(value, -kMost, kMost);
  return static_cast<T>(value) + T{0};
}

bool IsVector(PointField field) {
  return field == PointField::kPoint || field == PointField::kNormal;
}

/// The type of one field as a Python literal, e.g. `'<f4'`.
std::string_view Descr(PointField field, NumberType numbers) {
  const bool wide = numbers == NumberType::kF8;
  if (field == PointField::kTriangle) return wide ? "'<i8'" : "'<i4'";
  return wide ? "'<f8'" : "'<f4'";
}

template <class T>
void AppendBytes(std::string* out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out->append(bytes, sizeof(T));
}

template <class T>
void AppendVector(std::string* out, const Vec3& vector) {
  *out += '[';
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (axis != 0) *out += ',';
    AppendNumber(out, Narrow<T>(vector[axis]));
  }
  *out += ']';
}

/// Calls vector(v), number(x) or integer(i) with the field's value.
template <class OnVector, class OnNumber, class OnInteger>
void VisitField(const NearestPoint& row, PointField field, const OnVector& vector,
                const OnNumber& number, const OnInteger& integer) {
  switch (field) {
    case PointField::kDistance:
      return number(row.distance);
    case PointField::kPoint:
      return vector(row.point);
    case PointField::kTriangle:
      return integer(row.triangle);
    case PointField::kU:
      return number(row.u);
    case PointField::kV:
      return number(row.v);
    case PointField::kNormal:
      return vector(row.normal);
  }
}

ByteBlock BlockOf(std::string_view text) {
  ByteBlock block(text.size());
  std::copy(text.begin(), text.end(), block.data());
  return block;
}

void AppendList(std::string* out, const std::vector<std::uint64_t>& numbers) {
  *out += '[';
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (i != 0) *out += ',';
    *out += std::to_string(numbers[i]);
  }
  *out += ']';
}

}  // namespace

Outcome<std::size_t> MostJsonRows(std::string_view body, std::uint64_t max_rows,
                                  std::size_t row_bytes, const BatchWork& work) {
  const auto brackets = static_cast<std::uint64_t>(std::count(body.begin(), body.end(), ']'));
  const auto rows = static_cast<std::size_t>(std::min(brackets, max_rows));
  if (work.charge) {
    if (Check problem = work.charge(rows * row_bytes)) return *std::move(problem);
  }
  return rows;
}

Outcome<PointTable> PointsFromNpy(std::string_view body, std::uint64_t max_rows,
                                  const BatchWork& work) {
  const Outcome<NpyArray> array = ReadNpy(body);
  if (!array) return array.problem();
  if (array->shape.empty() || array->shape.back() != 3) {
    std::string shape;
    for (const std::size_t length : array->shape) {
      shape += (shape.empty() ? "" : ", ") + std::to_string(length);
    }
    if (array->shape.size() == 1) shape += ',';
    return Problem{ErrorCode::kInvalidArray,
                   "the array has the shape (" + shape + "); points have the shape (…, 3)"};
  }
  PointTable table;
  table.shape.assign(array->shape.begin(), array->shape.end() - 1);
  table.number_type = array->type;
  const std::size_t rows = array->data.size() / (array->type == NumberType::kF4 ? 12 : 24);
  if (rows > max_rows) return TooMany("the batch has rows: ", rows, max_rows);
  if (work.charge) {
    if (Check problem = work.charge(rows * sizeof(Vec3))) return *std::move(problem);
  }
  StopPoll poll(work.should_stop);
  table.rows = array->type == NumberType::kF4 ? RowsOf<float>(*array, rows, &poll)
                                              : RowsOf<double>(*array, rows, &poll);
  if (poll.stopped()) {
    return Problem{ErrorCode::kDeadlineExceeded, "the reading of the body was stopped"};
  }
  return table;
}

Outcome<PointTable> DecodePoints(std::string_view body, BatchType type, const Limits& limits,
                                 const BatchWork& work) {
  if (Check problem = CheckSize(body, limits)) return *std::move(problem);
  if (type == BatchType::kNpy) return PointsFromNpy(body, limits.max_rays, work);
  PointTable table;
  const auto most_rows = MostJsonRows(body, limits.max_rays, sizeof(Vec3), work);
  if (!most_rows) return most_rows.problem();
  table.rows.reserve(*most_rows);
  RowReader reader(
      body, kPoints, limits.max_rays,
      [&](std::size_t, std::span<const double> n) {
        table.rows.push_back({n[0], n[1], n[2]});
      },
      work.should_stop);
  if (Check problem = reader.Read()) return *std::move(problem);
  table.shape = {table.rows.size()};
  return table;
}

PointWriter::PointWriter(const PointTable& points, const PointOptions& options, BatchType type,
                         ChargeBytes charge)
    : points_(points),
      options_(options),
      type_(type),
      numbers_(options.dtype.value_or(points.number_type)),
      charge_(std::move(charge)) {
  if (type_ == BatchType::kJson) out_ = "{\"results\":[";
}

// A small piece waits for the next: a copy costs less than more sends.
Check PointWriter::EndPiece() {
  constexpr std::size_t kPieceBytes = 64 * 1024;
  if (out_.size() < kPieceBytes) return std::nullopt;
  if (charge_) {
    if (Check problem = charge_(out_.size())) return problem;
  }
  pieces_.push_back(BlockOf(out_));
  out_.clear();
  return std::nullopt;
}

void PointWriter::BeginNpy(std::string_view descr, bool of_vectors) {
  if (is_npy_begun_) return;
  is_npy_begun_ = true;
  std::vector<std::size_t> shape = points_.shape;
  if (of_vectors) shape.push_back(3);
  out_ = NpyHeader(descr, shape);
}

template <class T>
void PointWriter::PutAs(std::span<const NearestPoint> rows) {
  using Integer = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
  const std::vector<PointField>& fields = options_.fields;
  if (type_ == BatchType::kNpy) {
    std::string descr;
    for (const PointField field : fields) {
      descr += descr.empty() ? "[('" : ", ('";
      descr += Name(field);
      descr += "', ";
      descr += Descr(field, numbers_);
      descr += IsVector(field) ? ", (3,))" : ")";
    }
    const bool is_plain = fields.size() == 1;
    BeginNpy(is_plain ? std::string(Descr(fields[0], numbers_)) : descr + "]",
             is_plain && IsVector(fields[0]));
    for (const NearestPoint& row : rows) {
      for (const PointField field : fields) {
        VisitField(
            row, field,
            [&](const Vec3& v) {
              for (const double x : v) AppendBytes(&out_, Narrow<T>(x));
            },
            [&](double x) { AppendBytes(&out_, Narrow<T>(x)); },
            [&](std::int64_t i) { AppendBytes(&out_, static_cast<Integer>(i)); });
      }
    }
    return;
  }
  for (const NearestPoint& row : rows) {
    BeginRow();
    if (row.triangle < 0) {
      out_ += "null";
      continue;
    }
    char before = '{';
    for (const PointField field : fields) {
      out_ += before;
      before = ',';
      out_ += '"';
      out_ += Name(field);
      out_ += "\":";
      VisitField(
          row, field, [&](const Vec3& v) { AppendVector<T>(&out_, v); },
          [&](double x) { AppendNumber(&out_, Narrow<T>(x)); },
          [&](std::int64_t i) { AppendInteger(&out_, i); });
    }
    out_ += '}';
  }
}

Check PointWriter::Put(std::span<const NearestPoint> rows) {
  numbers_ == NumberType::kF4 ? PutAs<float>(rows) : PutAs<double>(rows);
  return EndPiece();
}

Check PointWriter::Put(std::span<const double> signed_distances) {
  const bool wide = numbers_ == NumberType::kF8;
  if (type_ == BatchType::kNpy) BeginNpy(wide ? "'<f8'" : "'<f4'", false);
  for (const double distance : signed_distances) {
    if (type_ == BatchType::kNpy) {
      wide ? AppendBytes(&out_, Narrow<double>(distance))
           : AppendBytes(&out_, Narrow<float>(distance));
    } else {
      BeginRow();
      wide ? AppendNumber(&out_, Narrow<double>(distance))
           : AppendNumber(&out_, Narrow<float>(distance));
    }
  }
  return EndPiece();
}

Check PointWriter::Put(std::span<const std::int8_t> inside) {
  if (type_ == BatchType::kNpy) {
    BeginNpy("'|i1'", false);
    for (const std::int8_t side : inside) out_ += static_cast<char>(side);
    return EndPiece();
  }
  for (const std::int8_t side : inside) {
    BeginRow();
    out_ += side < 0 ? "null" : side == 0 ? "false" : "true";
  }
  return EndPiece();
}

Outcome<std::vector<ByteBlock>> PointWriter::Finish(const std::vector<std::uint64_t>& invalid) && {
  if (type_ == BatchType::kJson) {
    out_ += "],\"invalid\":";
    AppendList(&out_, invalid);
    out_ += ",\"truncated\":[]}";
  }
  if (charge_) {
    if (Check problem = charge_(out_.size())) return *std::move(problem);
  }
  if (!out_.empty()) pieces_.push_back(BlockOf(out_));
  return std::move(pieces_);
}

}  // namespace kdray::api
