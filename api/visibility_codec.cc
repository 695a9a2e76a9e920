// SPDX-License-Identifier: Apache-2.0
#include "api/visibility_codec.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "api/json_row_reader.h"
#include "api/npy.h"
#include "api/point_codec.h"

namespace kdray::api {
namespace {

constexpr std::array<std::string_view, 2> kKeys = {"from", "to"};
constexpr RowForm kSets = {
    kKeys, "3 numbers (x y z)", {3, 3}, std::nullopt, ErrorCode::kTooManyRays};

Problem TooMany(std::string_view has, std::uint64_t actual, std::uint64_t limit) {
  Problem problem{ErrorCode::kTooManyRays, std::string(has) + std::to_string(actual) +
                                               "; at most " + std::to_string(limit) +
                                               " are allowed"};
  problem.limit = static_cast<double>(limit);
  problem.actual = static_cast<double>(actual);
  return problem;
}

}  // namespace

Outcome<PointSets> DecodePointSets(std::string_view body, BatchType type,
                                   const VisibilityOptions& options, const Limits& limits,
                                   const BatchWork& work) {
  PointSets sets;
  if (type == BatchType::kNpy) {
    if (!options.from_count) {
      return Problem{ErrorCode::kInvalidParameter,
                     "from_count is missing: the number of rows of the array "
                     "that are `from`; the "
                     "others are `to`",
                     "from_count"};
    }
    Outcome<PointTable> table = PointsFromNpy(body, 2 * limits.max_rays, work);
    if (!table) return std::move(table).problem();
    const auto count = static_cast<std::uint64_t>(*options.from_count);
    if (count > table->size()) {
      return Problem{ErrorCode::kInvalidParameter,
                     "from_count is " + std::to_string(count) + ", and the array has " +
                         std::to_string(table->size()) + " rows",
                     "from_count"};
    }
    if (work.charge) {
      if (Check problem = work.charge(table->size() * sizeof(Vec3))) return *std::move(problem);
    }
    sets.number_type = table->number_type;
    sets.to.assign(table->rows.begin() + static_cast<std::ptrdiff_t>(count), table->rows.end());
    sets.from = std::move(table->rows);
    sets.from.resize(count);
  } else {
    if (options.from_count) {
      return Problem{ErrorCode::kInvalidParameter,
                     "from_count is for .npy arrays; a JSON body has `from` and `to`",
                     "from_count"};
    }
    // Either set may have all rows.
    const auto most_rows = MostJsonRows(body, limits.max_rays, 2 * sizeof(Vec3), work);
    if (!most_rows) return most_rows.problem();
    sets.from.reserve(*most_rows);
    sets.to.reserve(*most_rows);
    RowReader reader(
        body, kSets, limits.max_rays,
        [&](std::size_t key, std::span<const double> n) {
          (key == 0 ? sets.from : sets.to).push_back({n[0], n[1], n[2]});
        },
        work.should_stop);
    if (Check problem = reader.Read()) return *std::move(problem);
  }
  const std::size_t most = std::max(sets.from.size(), sets.to.size());
  if (most > limits.max_rays) return TooMany("a set has points: ", most, limits.max_rays);
  const std::uint64_t pairs = std::uint64_t{sets.from.size()} * sets.to.size();
  if (pairs > limits.max_rays) {
    return TooMany("from and to make pairs: ", pairs, limits.max_rays);
  }
  return sets;
}

Check CheckAnswerType(const VisibilityOptions& options, BatchType type) {
  if (!options.bits || type == BatchType::kNpy) return std::nullopt;
  return Problem{ErrorCode::kInvalidParameter, "bits is for answers in .npy; this one is JSON",
                 "bits"};
}

std::string EncodeVisibility(const VisibilityAnswer& answer, const PointSets& sets,
                             const VisibilityOptions& options, BatchType type,
                             const ShouldStop& should_stop) {
  const std::size_t rows = sets.from.size(), columns = sets.to.size();
  if (type == BatchType::kNpy) {
    const std::size_t row_bytes = options.bits ? (columns + 7) / 8 : columns;
    const std::array<std::size_t, 2> shape = {rows, row_bytes};
    std::string out = NpyHeader(options.bits ? "'|u1'" : "'|b1'", shape);
    out.append(reinterpret_cast<const char*>(answer.visible.data()), answer.visible.size());
    return out;
  }
  StopPoll poll(should_stop);
  std::string out;
  // One allocation: a text that grows would be copied, and take the memory twice.
  constexpr std::size_t kMostWordBytes = 6;
  out.reserve(rows * (columns * kMostWordBytes + 3) + answer.invalid.size() * 12 + 64);
  out += "{\"visible\":[";
  for (std::size_t row = 0; row < rows; ++row) {
    if (poll.Row()) return {};
    out += row == 0 ? "[" : ",[";
    for (std::size_t column = 0; column < columns; ++column) {
      if (poll.Row()) return {};
      if (column != 0) out += ',';
      out += answer.visible[row * columns + column] != 0 ? "true" : "false";
    }
    out += ']';
  }
  out += "],\"invalid\":[";
  for (std::size_t i = 0; i < answer.invalid.size(); ++i) {
    if (i != 0) out += ',';
    out += std::to_string(answer.invalid[i]);
  }
  out += "]}";
  return out;
}

}  // namespace kdray::api
