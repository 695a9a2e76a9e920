#include "api/json_batch.h"

#include <array>
#include <span>
#include <utility>

#include "api/json_row_reader.h"

namespace kdray::api {
namespace {

constexpr std::array<std::string_view, 1> kKeys = {"rays"};
constexpr RowForm kRays = {kKeys,
                           "6 numbers (ox oy oz dx dy dz) or 8 (then t_min t_max)",
                           {6, 8},
                           7,
                           ErrorCode::kTooManyRays};

}  // namespace

Outcome<std::vector<RayRow<double>>> ReadRayRows(std::string_view json_text, double t_min,
                                                 double t_max, std::uint64_t max_rows,
                                                 const ShouldStop& should_stop) {
  std::vector<RayRow<double>> rows;
  const auto emit = [&](std::size_t, std::span<const double> n) {
    const bool with_interval = n.size() == 8;
    rows.push_back({n[0], n[1], n[2], with_interval ? n[6] : t_min, n[3], n[4], n[5],
                    with_interval ? n[7] : t_max});
  };
  RowReader reader(json_text, kRays, max_rows, emit, should_stop);
  if (Check problem = reader.Read()) return *std::move(problem);
  return rows;
}

}  // namespace kdray::api
