// SPDX-License-Identifier: Apache-2.0
#include "api/json_batch.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "api/json_row_reader.h"
#include "api/json_rows.h"

namespace kdray::api {
namespace {

constexpr std::array<std::string_view, 1> kKeys = {"rays"};
constexpr RowForm kRays = {kKeys,
                           "6 numbers (ox oy oz dx dy dz) or 8 (then t_min t_max)",
                           {6, 8},
                           7,
                           ErrorCode::kTooManyRays};

}  // namespace

Outcome<RayTable> ReadRayRows(std::string_view json_text, double t_min, double t_max,
                              std::uint64_t max_rows, const BatchWork& work) {
  Outcome<std::optional<RayTable>> plain = ReadPlainRays(json_text, t_min, t_max, max_rows, work);
  if (!plain) return std::move(plain).problem();
  if (*plain) return **std::move(plain);

  // Every row ends with a bracket, so there is room for all rows before they are counted.
  const auto brackets =
      static_cast<std::uint64_t>(std::count(json_text.begin(), json_text.end(), ']'));
  const auto most_rows = static_cast<std::size_t>(std::min(brackets, max_rows));
  if (work.charge) {
    if (Check problem = work.charge(most_rows * kRayNumbers * sizeof(double))) {
      return *std::move(problem);
    }
  }
  auto numbers = std::make_unique_for_overwrite<double[]>(most_rows * kRayNumbers);
  double* out = numbers.get();
  const auto emit = [&](std::size_t, std::span<const double> n) {
    const bool with_interval = n.size() == 8;
    const double row[kRayNumbers] = {n[0], n[1], n[2], with_interval ? n[6] : t_min,
                                     n[3], n[4], n[5], with_interval ? n[7] : t_max};
    out = std::copy(row, row + kRayNumbers, out);
  };
  RowReader reader(json_text, kRays, max_rows, emit, work.should_stop);
  if (Check problem = reader.Read()) return *std::move(problem);
  return RayTable(std::move(numbers), static_cast<std::size_t>(out - numbers.get()) / kRayNumbers);
}

}  // namespace kdray::api
