// SPDX-License-Identifier: Apache-2.0
#include "api/ray_table.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <optional>
#include <string>
#include <utility>

namespace kdray::api {
namespace {

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

template <class T>
std::span<char> BytesOf(std::span<T> numbers) {
  return {reinterpret_cast<char*>(numbers.data()), numbers.size_bytes()};
}

std::string ShapeText(const std::vector<std::size_t>& shape) {
  std::string text = "(";
  for (std::size_t i = 0; i < shape.size(); ++i) {
    if (i != 0) text += ", ";
    text += std::to_string(shape[i]);
  }
  return text + (shape.size() == 1 ? ",)" : ")");
}

}  // namespace

RayTable::RayTable(std::unique_ptr<double[]> numbers, std::size_t rows)
    : shape_{rows}, rows_(rows), source_(std::move(numbers)) {}

RayTable::RayTable(std::vector<std::size_t> shape, RayBlocks blocks)
    : shape_(std::move(shape)),
      rows_(blocks.rows),
      number_type_(blocks.sent),
      row_type_(blocks.sent),
      source_(std::move(blocks)) {}

Outcome<RayTable> RayTable::FromNpy(NpyArray array, double t_min, double t_max,
                                    std::uint64_t max_rows) {
  const std::optional<RayRowForm> form = RayRowForm::Of(array, t_min, t_max);
  if (!form) {
    return Problem{ErrorCode::kInvalidArray, "the array has the shape " + ShapeText(array.shape) +
                                                 "; rays have the shape (…, 6) or (…, 8)"};
  }
  RayTable table;
  table.shape_.assign(array.shape.begin(), array.shape.end() - 1);
  table.rows_ = array.data.size() / form->RowBytes();
  if (table.rows_ > max_rows) {
    Problem problem{ErrorCode::kTooManyRays, "the batch has " + std::to_string(table.rows_) +
                                                 " rows; at most " + std::to_string(max_rows) +
                                                 " are allowed"};
    problem.limit = static_cast<double>(max_rows);
    problem.actual = static_cast<double>(table.rows_);
    return problem;
  }
  table.number_type_ = array.type;
  table.row_type_ = form->RayType();
  table.source_ = NpyRows{std::move(array), *form};
  return table;
}

template <class T>
void RayTable::ReadNpy(const NpyRows& npy, std::size_t first_row, std::span<T> numbers) const {
  const char* data = npy.array.data.data();
  if (!npy.array.fortran_order) {
    return npy.form.Read(data + first_row * npy.form.RowBytes(), numbers);
  }
  const std::size_t bytes = RayRowForm::BytesOf(npy.form.sent);
  FortranOrder order(shape_, first_row);
  for (std::size_t at = 0; at < numbers.size(); at += kRayNumbers, order.Next()) {
    npy.form.ReadColumns(data + order.at() * bytes, rows_ * bytes,
                         numbers.subspan(at).template first<kRayNumbers>());
  }
}

std::span<const char> RayTable::InBlock(std::size_t first_row) const {
  const RayBlocks& in = std::get<RayBlocks>(source_);
  const std::size_t ray_bytes = kRayNumbers * RayRowForm::BytesOf(row_type_);
  const std::string_view block = in.blocks[first_row / in.rows_in_block].view();
  return block.substr(first_row % in.rows_in_block * ray_bytes);
}

void RayTable::ReadBlocks(std::size_t first_row, std::span<char> out) const {
  const std::size_t ray_bytes = kRayNumbers * RayRowForm::BytesOf(row_type_);
  while (!out.empty()) {
    const std::span<const char> block = InBlock(first_row);
    const std::size_t bytes = std::min(block.size(), out.size());
    std::copy_n(block.begin(), bytes, out.begin());
    out = out.subspan(bytes);
    first_row += bytes / ray_bytes;
  }
}

void RayTable::Read(std::size_t first_row, std::span<float> numbers) const {
  assert(row_type_ == NumberType::kF4);
  if (numbers.empty()) return;
  if (blocks() != nullptr) return ReadBlocks(first_row, BytesOf(numbers));
  ReadNpy(std::get<NpyRows>(source_), first_row, numbers);
}

void RayTable::Read(std::size_t first_row, std::span<double> numbers) const {
  assert(row_type_ == NumberType::kF8);
  if (numbers.empty()) return;
  if (blocks() != nullptr) return ReadBlocks(first_row, BytesOf(numbers));
  if (const auto* rows = std::get_if<std::unique_ptr<double[]>>(&source_)) {
    std::copy_n(rows->get() + first_row * kRayNumbers, numbers.size(), numbers.begin());
  } else {
    ReadNpy(std::get<NpyRows>(source_), first_row, numbers);
  }
}

std::span<const char> RayTable::MemoryOf(std::size_t rows) const {
  if (blocks() != nullptr) return {};
  if (const auto* numbers = std::get_if<std::unique_ptr<double[]>>(&source_)) {
    return {reinterpret_cast<const char*>(numbers->get()), rows * kRayNumbers * sizeof(double)};
  }
  const NpyArray& array = std::get<NpyRows>(source_).array;
  if (array.fortran_order || rows_ == 0) return {};
  return array.data.substr(0, array.data.size() / rows_ * rows);
}

std::size_t RayTable::FreeBlocks(std::size_t rows) {
  auto* const in = std::get_if<RayBlocks>(&source_);
  if (in == nullptr) return 0;
  const std::size_t read =
      rows == rows_ ? in->blocks.size() : std::min(rows / in->rows_in_block, in->blocks.size());
  std::size_t freed = 0;
  for (std::size_t i = read; i > 0 && in->blocks[i - 1].capacity() != 0; --i) {
    freed += in->blocks[i - 1].capacity();
    in->blocks[i - 1] = ByteBlock();
  }
  return freed;
}

}  // namespace kdray::api
