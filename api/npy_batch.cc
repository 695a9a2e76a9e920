#include "api/npy_batch.h"

#include <bit>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

namespace kdray::api {
namespace {

static_assert(std::endian::native == std::endian::little,
              ".npy elements are copied as they are; a big-endian machine has to swap them");

/// Calls `visit(f)` for each row in C order with its number in Fortran order, the order of its
/// elements in memory, until it returns false.
template <class Visit>
void InFortranOrder(const std::vector<std::size_t>& shape, std::size_t rows, Visit visit) {
  std::vector<std::size_t> index(shape.size(), 0), stride(shape.size(), 1);
  for (std::size_t d = 1; d < shape.size(); ++d) stride[d] = stride[d - 1] * shape[d - 1];
  std::size_t f = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    if (!visit(f)) return;
    for (std::size_t d = shape.size(); d-- > 0;) {
      f += stride[d];
      if (++index[d] < shape[d]) break;
      f -= stride[d] * shape[d];
      index[d] = 0;
    }
  }
}

/// `Sent` is the type of the elements, `Kept` that of the rows. Some are missing once `poll` has
/// stopped.
template <class Sent, class Kept>
std::vector<RayRow<Kept>> Rows(const NpyArray& array, const std::vector<std::size_t>& leading,
                               std::size_t rows, Kept t_min, Kept t_max, StopPoll* poll) {
  const std::size_t columns = array.shape.back();
  const bool with_interval = columns == 8;
  std::vector<RayRow<Kept>> out;
  out.reserve(rows);
  const auto append = [&](const Sent* n) {
    const auto kept = [&](std::size_t column) { return static_cast<Kept>(n[column]); };
    out.push_back({kept(0), kept(1), kept(2), with_interval ? kept(6) : t_min, kept(3), kept(4),
                   kept(5), with_interval ? kept(7) : t_max});
  };
  // The elements are not aligned, so they are copied.
  Sent n[8] = {};
  if (!array.fortran_order) {
    for (std::size_t row = 0; row < rows && !poll->Row(); ++row) {
      std::memcpy(n, array.data.data() + row * columns * sizeof(Sent), columns * sizeof(Sent));
      append(n);
    }
  } else {
    InFortranOrder(leading, rows, [&](std::size_t f) {
      for (std::size_t column = 0; column < columns; ++column) {
        std::memcpy(&n[column], array.data.data() + (column * rows + f) * sizeof(Sent),
                    sizeof(Sent));
      }
      append(n);
      return !poll->Row();
    });
  }
  return out;
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

Outcome<RayTable> RaysFromNpy(const NpyArray& array, double t_min, double t_max,
                              std::uint64_t max_rows, const ShouldStop& should_stop) {
  if (array.shape.empty() || (array.shape.back() != 6 && array.shape.back() != 8)) {
    return Problem{ErrorCode::kInvalidArray, "the array has the shape " + ShapeText(array.shape) +
                                                 "; rays have the shape (…, 6) or (…, 8)"};
  }
  RayTable table;
  table.shape.assign(array.shape.begin(), array.shape.end() - 1);
  const std::size_t row_bytes = array.shape.back() * (array.type == NumberType::kF4 ? 4 : 8);
  const std::size_t rows = array.data.size() / row_bytes;
  if (rows > max_rows) {
    Problem problem{ErrorCode::kTooManyRays, "the batch has " + std::to_string(rows) +
                                                 " rows; at most " + std::to_string(max_rows) +
                                                 " are allowed"};
    problem.limit = static_cast<double>(max_rows);
    problem.actual = static_cast<double>(rows);
    return problem;
  }

  StopPoll poll(should_stop);
  const bool interval_fits = array.shape.back() == 8 || (FitsFloat(t_min) && FitsFloat(t_max));
  if (array.type == NumberType::kF8) {
    table.rows = Rows<double, double>(array, table.shape, rows, t_min, t_max, &poll);
  } else if (interval_fits) {
    table.rows = Rows<float, float>(array, table.shape, rows, static_cast<float>(t_min),
                                    static_cast<float>(t_max), &poll);
  } else {
    table.rows = Rows<float, double>(array, table.shape, rows, t_min, t_max, &poll);
  }
  if (poll.stopped()) {
    return Problem{ErrorCode::kDeadlineExceeded, "the reading of the body was stopped"};
  }
  table.sent_as = array.type;
  return table;
}

}  // namespace kdray::api
