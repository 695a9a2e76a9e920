// SPDX-License-Identifier: Apache-2.0
#include "api/ray_table.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>
#include <string>
#include <type_traits>

namespace kdray::api {
namespace {

static_assert(std::endian::native == std::endian::little,
              ".npy elements are copied as they are; a big-endian machine has to swap them");

/// The rows of a leading shape in C order, with their numbers in Fortran order, the order of their
/// elements in memory.
class FortranOrder {
 public:
  FortranOrder(const std::vector<std::size_t>& shape, std::size_t first_row)
      : shape_(shape), index_(shape.size()), stride_(shape.size(), 1) {
    for (std::size_t d = 1; d < shape_.size(); ++d) stride_[d] = stride_[d - 1] * shape_[d - 1];
    for (std::size_t d = shape_.size(); d-- > 0;) {
      index_[d] = first_row % shape_[d];
      first_row /= shape_[d];
      at_ += index_[d] * stride_[d];
    }
  }
  std::size_t at() const { return at_; }
  void Next() {
    for (std::size_t d = shape_.size(); d-- > 0;) {
      at_ += stride_[d];
      if (++index_[d] < shape_[d]) break;
      at_ -= stride_[d] * shape_[d];
      index_[d] = 0;
    }
  }

 private:
  const std::vector<std::size_t>& shape_;
  std::vector<std::size_t> index_, stride_;
  std::size_t at_ = 0;
};

/// Puts a row of 6 or 8 columns into the order of kRayNumbers.
template <class Sent, class T>
void PutRow(const Sent* n, bool with_interval, T t_min, T t_max, T* out) {
  out[0] = static_cast<T>(n[0]);
  out[1] = static_cast<T>(n[1]);
  out[2] = static_cast<T>(n[2]);
  out[3] = with_interval ? static_cast<T>(n[6]) : t_min;
  out[4] = static_cast<T>(n[3]);
  out[5] = static_cast<T>(n[4]);
  out[6] = static_cast<T>(n[5]);
  out[7] = with_interval ? static_cast<T>(n[7]) : t_max;
}

/// Rows of kColumns in C order. The elements are not aligned, so they are copied.
template <std::size_t kColumns, class Sent, class T>
void ReadInOrder(const char* data, T t_min, T t_max, std::span<T> numbers) {
  if constexpr (std::is_same_v<Sent, T>) {
    // Three numbers at a time, without a conversion: this is what most batches are.
    constexpr std::size_t kVector = 3 * sizeof(T);
    for (T *out = numbers.data(), *end = out + numbers.size(); out != end; out += kRayNumbers) {
      std::memcpy(out, data, kVector);
      std::memcpy(out + 4, data + kVector, kVector);
      if constexpr (kColumns == 8) {
        std::memcpy(out + 3, data + 2 * kVector, sizeof(T));
        std::memcpy(out + 7, data + 2 * kVector + sizeof(T), sizeof(T));
      } else {
        out[3] = t_min;
        out[7] = t_max;
      }
      data += kColumns * sizeof(T);
    }
    return;
  }
  for (std::size_t at = 0; at < numbers.size(); at += kRayNumbers) {
    Sent n[kRayNumbers] = {};
    std::memcpy(n, data, kColumns * sizeof(Sent));
    data += kColumns * sizeof(Sent);
    PutRow(n, kColumns == 8, t_min, t_max, &numbers[at]);
  }
}

std::string ShapeText(const std::vector<std::size_t>& shape) {
  std::string text = "(";
  for (std::size_t i = 0; i < shape.size(); ++i) {
    if (i != 0) text += ", ";
    text += std::to_string(shape[i]);
  }
  return text + (shape.size() == 1 ? ",)" : ")");
}

bool FitsFloat(double value) { return static_cast<double>(static_cast<float>(value)) == value; }

}  // namespace

RayTable::RayTable(std::unique_ptr<double[]> numbers, std::size_t rows)
    : shape_{rows}, rows_(rows), source_(std::move(numbers)) {}

Outcome<RayTable> RayTable::FromNpy(NpyArray array, double t_min, double t_max,
                                    std::uint64_t max_rows) {
  if (array.shape.empty() || (array.shape.back() != 6 && array.shape.back() != 8)) {
    return Problem{ErrorCode::kInvalidArray, "the array has the shape " + ShapeText(array.shape) +
                                                 "; rays have the shape (…, 6) or (…, 8)"};
  }
  RayTable table;
  table.shape_.assign(array.shape.begin(), array.shape.end() - 1);
  const std::size_t row_bytes = array.shape.back() * (array.type == NumberType::kF4 ? 4 : 8);
  table.rows_ = array.data.size() / row_bytes;
  if (table.rows_ > max_rows) {
    Problem problem{ErrorCode::kTooManyRays, "the batch has " + std::to_string(table.rows_) +
                                                 " rows; at most " + std::to_string(max_rows) +
                                                 " are allowed"};
    problem.limit = static_cast<double>(max_rows);
    problem.actual = static_cast<double>(table.rows_);
    return problem;
  }
  const bool interval_fits = array.shape.back() == 8 || (FitsFloat(t_min) && FitsFloat(t_max));
  table.number_type_ = array.type;
  table.row_type_ = interval_fits ? array.type : NumberType::kF8;
  table.source_ = NpyRows{std::move(array), t_min, t_max};
  return table;
}

template <class Sent, class T>
void RayTable::ReadNpy(const NpyRows& npy, std::size_t first_row, std::span<T> numbers) const {
  const auto t_min = static_cast<T>(npy.t_min), t_max = static_cast<T>(npy.t_max);
  const std::size_t columns = npy.array.shape.back();
  const char* data = npy.array.data.data();
  if (!npy.array.fortran_order) {
    data += first_row * columns * sizeof(Sent);
    return columns == 8 ? ReadInOrder<8, Sent>(data, t_min, t_max, numbers)
                        : ReadInOrder<6, Sent>(data, t_min, t_max, numbers);
  }
  FortranOrder order(shape_, first_row);
  for (std::size_t at = 0; at < numbers.size(); at += kRayNumbers, order.Next()) {
    Sent n[kRayNumbers] = {};
    for (std::size_t column = 0; column < columns; ++column) {
      std::memcpy(&n[column], data + (column * rows_ + order.at()) * sizeof(Sent), sizeof(Sent));
    }
    PutRow(n, columns == 8, t_min, t_max, &numbers[at]);
  }
}

void RayTable::Read(std::size_t first_row, std::span<float> numbers) const {
  assert(row_type_ == NumberType::kF4);
  if (numbers.empty()) return;
  ReadNpy<float>(std::get<NpyRows>(source_), first_row, numbers);
}

void RayTable::Read(std::size_t first_row, std::span<double> numbers) const {
  assert(row_type_ == NumberType::kF8);
  if (numbers.empty()) return;
  if (const auto* rows = std::get_if<std::unique_ptr<double[]>>(&source_)) {
    std::copy_n(rows->get() + first_row * kRayNumbers, numbers.size(), numbers.begin());
  } else if (number_type_ == NumberType::kF8) {
    ReadNpy<double>(std::get<NpyRows>(source_), first_row, numbers);
  } else {
    ReadNpy<float>(std::get<NpyRows>(source_), first_row, numbers);
  }
}

std::span<const char> RayTable::MemoryOf(std::size_t rows) const {
  if (const auto* numbers = std::get_if<std::unique_ptr<double[]>>(&source_)) {
    return {reinterpret_cast<const char*>(numbers->get()), rows * kRayNumbers * sizeof(double)};
  }
  const NpyArray& array = std::get<NpyRows>(source_).array;
  if (array.fortran_order || rows_ == 0) return {};
  return array.data.substr(0, array.data.size() / rows_ * rows);
}

}  // namespace kdray::api
