// SPDX-License-Identifier: Apache-2.0
// Whole answers, encoded in one call or in blocks as a backend sends them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "api/batch_codec.h"

namespace kdray::api {

struct ClosestAnswer {
  std::vector<RayHit> hits = {};
  std::vector<Vec3> normals = {}, points = {};
  std::vector<std::int8_t> sides = {};
  std::vector<std::int32_t> groups = {};
  std::vector<std::array<double, 2>> uvs = {};
  std::vector<Vec3> shading_normals = {};
  std::vector<std::uint64_t> invalid = {};
};

/// A table of rays that only has a shape and a type.
inline RayTable RaysOfShape(std::vector<std::size_t> leading, NumberType type = NumberType::kF8) {
  static const std::string zeros(200'000 * 6 * 8, '\0');
  std::size_t bytes = 6 * (type == NumberType::kF4 ? 4 : 8);
  for (const std::size_t length : leading) bytes *= length;
  leading.push_back(6);
  return *RayTable::FromNpy(
      {type, false, std::move(leading), std::string_view(zeros).substr(0, bytes)}, 0, 1e-3,
      200'000);
}

inline std::string Join(Outcome<std::vector<ByteBlock>> pieces) {
  std::string text;
  EXPECT_TRUE(pieces);
  if (pieces) {
    for (const ByteBlock& piece : *pieces) text += piece.view();
  }
  return text;
}

template <class T>
std::span<const T> Part(const std::vector<T>& list, std::size_t first, std::size_t count) {
  return list.empty() ? std::span<const T>() : std::span(list).subspan(first, count);
}

/// Blocks of `block` rows; the pieces of a block come last first.
inline std::string EncodeClosest(const ClosestAnswer& answer, const RayTable& rays,
                                 const RayOptions& options, BatchType type,
                                 std::size_t block = 1 << 20) {
  const auto writer = WriterOfClosest(rays, options, type);
  const std::size_t count = answer.hits.size();
  for (std::size_t first = 0; first < count; first += block) {
    const std::size_t rows = std::min(block, count - first);
    EXPECT_FALSE(writer->Begin(rows));
    for (const bool second : {true, false}) {
      const std::size_t half = rows / 2;
      const std::size_t at = first + (second ? half : 0), n = second ? rows - half : half;
      writer->Put({.first_row = at,
                   .hits = {.hits = Part(answer.hits, at, n),
                            .normals = Part(answer.normals, at, n),
                            .points = Part(answer.points, at, n),
                            .sides = Part(answer.sides, at, n),
                            .groups = Part(answer.groups, at, n),
                            .uvs = Part(answer.uvs, at, n),
                            .shading_normals = Part(answer.shading_normals, at, n)}});
    }
  }
  BatchReport report;
  report.invalid = answer.invalid;
  return Join(std::move(*writer).Finish(report));
}

inline std::string EncodeAny(const std::vector<std::uint8_t>& occluded,
                             const std::vector<std::uint64_t>& invalid, const RayTable& rays,
                             BatchType type) {
  const auto writer = WriterOfAny(rays, {}, type);
  EXPECT_FALSE(writer->Begin(occluded.size()));
  writer->Put({.first_row = 0, .occluded = occluded});
  BatchReport report;
  report.invalid = invalid;
  return Join(std::move(*writer).Finish(report));
}

inline std::string EncodeCount(const std::vector<std::uint32_t>& counts,
                               const std::vector<std::uint64_t>& invalid, const RayTable& rays,
                               BatchType type, const RayOptions& options = {}) {
  const auto writer = WriterOfCount(rays, options, type);
  EXPECT_FALSE(writer->Begin(counts.size()));
  writer->Put({.first_row = 0, .counts = counts});
  BatchReport report;
  report.invalid = invalid;
  return Join(std::move(*writer).Finish(report));
}

/// `hits[i]` are those of row i; a block for each row.
inline std::string EncodeAll(const std::vector<std::vector<RayHit>>& hits,
                             const BatchReport& report, const RayTable& rays, BatchType type,
                             const RayOptions& options = {}) {
  const auto writer = WriterOfAll(rays, options, type);
  std::size_t first_hit = 0;
  for (std::size_t row = 0; row < hits.size(); ++row) {
    const std::vector<std::uint32_t> counts = {static_cast<std::uint32_t>(hits[row].size())};
    const std::vector<std::int8_t> sides(hits[row].size(), -1);
    EXPECT_FALSE(writer->Begin(hits[row].size()));
    writer->Put({.first_row = row,
                 .first_hit = first_hit,
                 .counts = counts,
                 .hits = {.hits = hits[row], .normals = {}, .points = {}, .sides = sides}});
    first_hit += hits[row].size();
  }
  return Join(std::move(*writer).Finish(report));
}

}  // namespace kdray::api
