// SPDX-License-Identifier: Apache-2.0
// The backend's batches of rays, compared with brute force.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "core/trace/brute_force.h"
#include "core/trace/trace.h"
#include "server/mapping.h"
#include "tests/support/mesh_files.h"
#include "tests/unit/server/core_backend_fixture.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
using testing::ElementsAre;

TEST_F(CoreBackendTest, ClosestHitsAreThoseOfBruteForceForFloatAndDoubleRows) {
  const auto mesh = core::TriangleMesh::Create(Sphere());
  ASSERT_TRUE(mesh.ok());
  const std::string id = Add(Sphere());
  const test::RayRows<float> narrow = SomeRays<float>(3000);
  const test::RayRows<double> wide = SomeRays<double>(3000);
  for (const api::RayTable* table : {&narrow.table(), &wide.table()}) {
    const auto answer = Closest(id, *table, {}, Soon());
    ASSERT_TRUE(answer.ok());
    const std::vector<api::RayHit>& hits = answer->rows->hits;
    ASSERT_EQ(hits.size(), 3000u);
    EXPECT_TRUE(answer->rows->normals.empty() && answer->rows->points.empty())
        << "they were not requested";
    std::size_t hit_count = 0;
    std::vector<std::uint64_t> invalid;
    const auto rows = test::RowsOf(*table);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (i % 10 == 7) {
        invalid.push_back(i);
        EXPECT_TRUE(std::isnan(hits[i].t));
        EXPECT_EQ(hits[i].triangle, -1);
        continue;
      }
      const core::Hit expected =
          core::BruteForceClosest(*mesh, RayOf(rows[i]), core::AutoPrecision(*mesh));
      hit_count += expected.IsHit() ? 1 : 0;
      ExpectSame(hits[i], ToApi({&expected, 1})[0]);
    }
    EXPECT_GT(hit_count, 500u);
    EXPECT_EQ(answer->report.invalid, invalid);
    EXPECT_GT(answer->report.trace_ms, 0);
  }
}

/// The rays of a table in blocks, as they arrive.
template <class T>
api::RayTable InBlocks(const api::RayTable& table, std::size_t rows_in_block,
                       std::vector<std::uint64_t> invalid) {
  api::RayBlocks blocks{.sent = table.row_type(),
                        .rows = table.size(),
                        .rows_in_block = rows_in_block,
                        .blocks = {},
                        .invalid = std::move(invalid)};
  for (std::size_t first = 0; first < table.size(); first += rows_in_block) {
    std::vector<T> numbers(std::min(rows_in_block, table.size() - first) * api::kRayNumbers);
    table.Read(first, numbers);
    blocks.blocks.emplace_back(numbers.size() * sizeof(T));
    std::memcpy(blocks.blocks.back().data(), numbers.data(), blocks.blocks.back().size());
  }
  return {{table.size()}, std::move(blocks)};
}

TEST_F(CoreBackendTest, RaysInBlocksAreTracedWhereTheyLieWithTheSameAnswers) {
  const std::string id = Add(Sphere());
  const test::RayRows<float> narrow = SomeRays<float>(140'000);
  const test::RayRows<double> wide = SomeRays<double>(5000);
  const auto compare = [&](const api::RayTable& table, auto number, std::size_t rows_in_block) {
    const auto want = Closest(id, table, {}, Soon());
    const auto want_all = All(id, table, {}, Soon());
    ASSERT_TRUE(want.ok() && want_all.ok());
    const api::RayTable blocks =
        InBlocks<decltype(number)>(table, rows_in_block, want->report.invalid);
    const auto closest = Closest(id, blocks, {}, Soon());
    const auto any = Any(id, blocks, {}, Soon());
    const auto all = All(id, blocks, {}, Soon());
    ASSERT_TRUE(closest.ok() && any.ok() && all.ok());
    for (std::size_t i = 0; i < table.size(); ++i) {
      ExpectSame(closest->rows->hits[i], want->rows->hits[i]);
      EXPECT_EQ(any->rows->occluded[i] != 0, want->rows->hits[i].triangle >= 0);
    }
    EXPECT_EQ(all->rows->counts, want_all->rows->counts);
    EXPECT_EQ(all->report.truncated, want_all->report.truncated);
    for (const api::BatchReport* report : {&closest->report, &any->report, &all->report}) {
      EXPECT_EQ(report->invalid, want->report.invalid);
    }
  };
  compare(narrow.table(), float{}, 131'072);
  compare(wide.table(), double{}, 512);
  compare(wide.table(), double{}, 5000);
}

TEST_F(CoreBackendTest, ABatchLongerThanABlockIsAnsweredLikeItsParts) {
  const std::string id = Add(Sphere());
  const test::RayRows<double> all = SomeRays<double>(300'000);
  const auto answer = Closest(id, all.table(), {}, Soon());
  const auto any = Any(id, all.table(), {}, Soon());
  const auto count = Count(id, all.table(), {}, Soon());
  const auto lists = All(id, all.table(), {}, Soon());
  ASSERT_TRUE(answer.ok() && any.ok() && count.ok() && lists.ok());
  const std::vector<std::uint64_t>& invalid = answer->report.invalid;
  EXPECT_EQ(invalid.size(), 30'000u);
  EXPECT_TRUE(any->report.invalid == invalid && count->report.invalid == invalid &&
              lists->report.invalid == invalid);
  EXPECT_TRUE(std::is_sorted(invalid.begin(), invalid.end()));
  EXPECT_EQ(lists->rows->counts, count->rows->counts);
  for (const std::size_t first : {std::size_t{0}, std::size_t{131'000}, std::size_t{262'100}}) {
    const auto from = all.rows().begin() + std::ptrdiff_t(first);
    const test::RayRows<double> part({from, from + 200});
    const auto part_answer = Closest(id, part.table(), {}, Soon());
    const auto part_count = Count(id, part.table(), {}, Soon());
    ASSERT_TRUE(part_answer.ok() && part_count.ok());
    for (std::size_t i = 0; i < 200; ++i) {
      ExpectSame(answer->rows->hits[first + i], part_answer->rows->hits[i]);
      EXPECT_EQ(any->rows->occluded[first + i], part_answer->rows->hits[i].triangle >= 0 ? 1 : 0);
      EXPECT_EQ(count->rows->counts[first + i], part_count->rows->counts[i]);
    }
  }
}

TEST_F(CoreBackendTest, DetailsOfHitsComeWhenTheyAreAskedFor) {
  const std::string id = Add(test::Cube({0, 0, 0}, 2));
  const test::RayRows<double> rays({{-10, 0.5, 0.25, 0, 2, 0, 0, 1e300},
                                    {-10, 50, 0, 0, 1, 0, 0, 1e300},
                                    {0.5, 0.25, 10, 0, 0, 0, -1, 1e300},
                                    {0.5, 0.25, 0, 0, 0, 0, 1, 1e300}});
  api::RayOptions options;
  options.fields = {api::RayField::kT, api::RayField::kNormal, api::RayField::kPoint,
                    api::RayField::kSide};
  const auto answer = Closest(id, rays.table(), options, Soon());
  ASSERT_TRUE(answer.ok());
  const auto& rows = *answer->rows;
  EXPECT_EQ(rows.hits[0].t, 4.0) << "counts lengths of the direction";
  EXPECT_THAT(rows.normals[0], ElementsAre(-1, 0, 0)) << "outward, by the order of corners";
  EXPECT_THAT(rows.points[0], ElementsAre(-2, 0.5, 0.25));
  EXPECT_EQ(rows.hits[1].triangle, -1);
  EXPECT_TRUE(std::isnan(rows.normals[1][0]) && std::isnan(rows.points[1][2]));
  EXPECT_THAT(rows.normals[2], ElementsAre(0, 0, 1));
  EXPECT_THAT(rows.points[2], ElementsAre(0.5, 0.25, 2));
  EXPECT_THAT(rows.normals[3], ElementsAre(0, 0, 1)) << "not turned towards the ray";
  EXPECT_THAT(rows.sides, ElementsAre(1, 0, 1, -1));
}

TEST_F(CoreBackendTest, AttributesOfTheFileAreReadWhenTheyAreNamed) {
  const auto stored =
      Upload(test::Bytes("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
                         "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nvn 1 0 0\n"
                         "g first\nf 1/1/1 2/2/1 3/3/2\ng second\nf 1 3 4\n"));
  ASSERT_TRUE(stored.ok());
  const test::RayRows<double> rays({{0.75, 0.25, 1, 0, 0, 0, -1, 1e300},
                                    {0.25, 0.75, 1, 0, 0, 0, -1, 1e300},
                                    {9, 9, 1, 0, 0, 0, -1, 1e300}});
  const auto plain = Closest(stored->id, rays.table(), {}, Soon());
  ASSERT_TRUE(plain.ok());
  EXPECT_TRUE(plain->rows->groups.empty() && plain->rows->uvs.empty());
  EXPECT_EQ(backend_->counters().attribute_reads, 0u) << "no field needed them";
  api::RayOptions options;
  options.fields = {api::RayField::kGroup, api::RayField::kUv, api::RayField::kShadingNormal};
  const auto answer = Closest(stored->id, rays.table(), options, Soon());
  ASSERT_TRUE(answer.ok());
  EXPECT_THAT(answer->rows->groups, ElementsAre(0, 1, -1));
  EXPECT_THAT(answer->rows->uvs[0], ElementsAre(0.75, 0.25));
  const api::Vec3& normal = answer->rows->shading_normals[0];
  EXPECT_NEAR(normal[0] / normal[2], 1.0 / 3, 1e-6);
  EXPECT_NEAR(std::hypot(normal[0], normal[1], normal[2]), 1, 1e-12);
  for (const std::size_t row : {1u, 2u}) {
    EXPECT_TRUE(std::isnan(answer->rows->uvs[row][0]));
    EXPECT_TRUE(std::isnan(answer->rows->shading_normals[row][2]));
  }
}

TEST_F(CoreBackendTest, AllHitsAreListedNearestFirstAndCutAtMaxHits) {
  const std::string id = Add(Sphere());
  const test::RayRows<double> rays = SomeRays<double>(2000);
  api::RayOptions options;
  options.fields.push_back(api::RayField::kSide);
  const auto all = All(id, rays.table(), options, Soon());
  options.max_hits = 1;
  const auto nearest = All(id, rays.table(), options, Soon());
  ASSERT_TRUE(all.ok() && nearest.ok());
  EXPECT_EQ(all->report.precision, api::Precision::kExact);
  EXPECT_TRUE(all->report.truncated.empty());
  std::size_t hit = 0, kept = 0;
  std::vector<std::uint64_t> truncated;
  for (std::size_t row = 0; row < 2000; ++row) {
    const std::uint32_t count = all->rows->counts[row];
    EXPECT_EQ(nearest->rows->counts[row], std::min(count, 1u));
    if (count > 1) truncated.push_back(row);
    if (count > 0) ExpectSame(nearest->rows->hits[kept++], all->rows->hits[hit]);
    for (std::uint32_t i = 0; i < count; ++i, ++hit) {
      EXPECT_EQ(all->rows->sides[hit], (count - i) % 2 == 1 ? -1 : 1)
          << "out of a closed mesh last";
      if (i > 0) {
        EXPECT_LE(all->rows->hits[hit - 1].t, all->rows->hits[hit].t);
      }
    }
  }
  EXPECT_EQ(hit, all->rows->hits.size());
  EXPECT_GT(hit, 1000u);
  EXPECT_EQ(nearest->report.truncated, truncated);
}

TEST_F(CoreBackendTest, AnAnswerOfAllWithTooManyHitsIsRefused) {
  options_.limits.max_rays = 10;  // so 160 hits
  Open();
  const std::string id = Add(Sphere());
  const std::vector<test::RayRow<double>> rows(100, {-9, 2, 3, 0, 1, 0, 0, 1e300});
  EXPECT_TRUE(
      All(id, test::RayRows<double>({rows.begin(), rows.begin() + 80}).table(), {}, Soon()).ok());
  const auto refused = All(id, test::RayRows<double>(rows).table(), {}, Soon());
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.problem().code, ErrorCode::kTooManyHits);
  EXPECT_EQ(refused.problem().limit, 160);
}

TEST_F(CoreBackendTest, CullRemovesSidesFromEveryQuery) {
  const std::string id = Add(test::Cube({0, 0, 0}, 2));
  const test::RayRows<double> rays({{-10, 0.5, 0.25, 0, 1, 0, 0, 1e300}});
  for (const auto& [cull, t, triangles] :
       {std::tuple(api::Cull::kNone, 8.0, 2u), std::tuple(api::Cull::kBack, 8.0, 1u),
        std::tuple(api::Cull::kFront, 12.0, 1u)}) {
    for (const api::Precision precision : {api::Precision::kAuto, api::Precision::kFast,
                                           api::Precision::kDouble, api::Precision::kExact}) {
      api::RayOptions options;
      options.precision = precision;
      options.cull = cull;
      EXPECT_EQ(Closest(id, rays.table(), options, Soon())->rows->hits[0].t, t);
      EXPECT_THAT(Count(id, rays.table(), options, Soon())->rows->counts, ElementsAre(triangles));
      EXPECT_EQ(All(id, rays.table(), options, Soon())->rows->hits.size(), triangles);
      EXPECT_THAT(Any(id, rays.table(), options, Soon())->rows->occluded, ElementsAre(1));
    }
  }
}

TEST_F(CoreBackendTest, RaysBetweenSurfacesAreOfferedTheOffsetOfTheirEnds) {
  const std::string id = Add(test::Cube({0, 0, 0}, 2));
  // From one side of the cube to the opposite one, which "auto" does not hit.
  const test::RayRows<float> narrow({{-2, 0.5F, 0.25F, 0, 4, 0, 0, 1e30F}});
  const test::RayRows<double> wide({{-2, 0.5, 0.25, 0, 4, 0, 0, 1e300}});
  api::RayOptions options;
  EXPECT_FALSE(Any(id, wide.table(), options, Soon())->report.offset);
  EXPECT_THAT(Any(id, wide.table(), options, Soon())->rows->occluded, ElementsAre(1));
  options.auto_t_min = true;
  EXPECT_EQ(Closest(id, wide.table(), options, Soon())->rows->hits[0].t, 1.0);
  options.auto_t_max = true;
  const auto in_double = Any(id, wide.table(), options, Soon());
  const auto in_float = Any(id, narrow.table(), options, Soon());
  EXPECT_THAT(in_double->rows->occluded, ElementsAre(0));
  EXPECT_THAT(in_float->rows->occluded, ElementsAre(0));
  ASSERT_TRUE(in_double->report.offset && in_float->report.offset);
  EXPECT_GT(*in_double->report.offset, 0);
  EXPECT_LT(*in_double->report.offset, *in_float->report.offset) << "double needs less room";
}

TEST_F(CoreBackendTest, EveryPrecisionIsAnsweredUnderItsName) {
  const std::string id = Add(Sphere());
  for (const api::Precision precision : {api::Precision::kFast, api::Precision::kWatertight,
                                         api::Precision::kDouble, api::Precision::kExact}) {
    api::RayOptions options;
    options.precision = precision;
    const auto closest = Closest(id, SomeRays<double>(100).table(), options, Soon());
    const auto any = Any(id, SomeRays<double>(100).table(), options, Soon());
    ASSERT_TRUE(closest.ok() && any.ok());
    EXPECT_EQ(closest->report.precision, precision);
    EXPECT_EQ(any->report.precision, precision);
  }
}

TEST_F(CoreBackendTest, ABatchOfNothingIsAnsweredWithNothing) {
  const std::string id = Add(Sphere());
  const auto closest = Closest(id, SomeRays<float>(0).table(), {}, Soon());
  ASSERT_TRUE(closest.ok());
  EXPECT_TRUE(closest->rows->hits.empty() && closest->report.invalid.empty());
  EXPECT_TRUE(Any(id, SomeRays<float>(0).table(), {}, Soon())->rows->occluded.empty());
  EXPECT_TRUE(Count(id, SomeRays<float>(0).table(), {}, Soon())->rows->counts.empty());
  EXPECT_TRUE(All(id, SomeRays<float>(0).table(), {}, Soon())->rows->hits.empty());
}

TEST_F(CoreBackendTest, ADeadlineThatHasPassedIsExceeded) {
  const std::string id = Add(Sphere());
  const CancelToken late = CancelToken::WithDeadline(steady_clock::now() - milliseconds(1));
  EXPECT_EQ(Closest(id, SomeRays<double>(1000).table(), {}, late).problem().code,
            ErrorCode::kDeadlineExceeded);
  EXPECT_EQ(Any(id, SomeRays<double>(1000).table(), {}, late).problem().code,
            ErrorCode::kDeadlineExceeded);
  EXPECT_EQ(Render(id, {}, true, late).problem().code, ErrorCode::kDeadlineExceeded);
}

}  // namespace
}  // namespace kdray::server
