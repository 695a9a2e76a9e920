// SPDX-License-Identifier: Apache-2.0
// The backend in the contract's words, on real meshes and a disk of its own.
#include "server/core_backend.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <random>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "core/base/hash.h"
#include "core/trace/brute_force.h"
#include "core/trace/trace.h"
#include "server/mapping.h"
#include "tests/support/mesh_files.h"
#include "tests/support/off_text.h"
#include "tests/support/ray_rows.h"
#include "tests/support/seed.h"
#include "tests/support/shapes.h"
#include "tests/support/simulated_disk.h"

namespace kdray::server {
namespace {

using api::ErrorCode;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
using testing::ElementsAre;
using testing::HasSubstr;

using MeshBytesVector = std::vector<std::byte>;

/// The rows of an answer, and its report.
template <class Rows>
struct Answer {
  std::shared_ptr<test::Collected<Rows>> rows = std::make_shared<test::Collected<Rows>>();
  api::BatchReport report;
};
using ClosestAnswer = Answer<api::ClosestRows>;
using AnyAnswer = Answer<api::AnyRows>;
using CountAnswer = Answer<api::CountRows>;
using AllAnswer = Answer<api::AllRows>;

class CoreBackendTest : public testing::Test {
 protected:
  CoreBackendTest() {
    options_.data_dir = "data";
    options_.threads = 2;
    options_.file_system = &disk_;
    Open();
  }
  void Open() {
    backend_.reset();
    auto backend = MakeCoreBackend(options_);
    ASSERT_TRUE(backend.ok()) << backend.error().message;
    backend_ = *std::move(backend);
  }
  static CancelToken Soon() {
    return CancelToken::WithDeadline(steady_clock::now() + std::chrono::minutes(2));
  }
  api::Outcome<MeshUpload::Stored> Upload(const MeshBytesVector& bytes,
                                          api::Build build = api::Build::kAuto) {
    auto upload = backend_->BeginUpload(bytes.size());
    if (!upload.ok()) return upload.problem();
    if (api::Check check = (*upload)->Append(bytes)) return *std::move(check);
    return (*upload)->Finish(build);
  }
  std::string Add(const core::MeshData& mesh, api::Build build = api::Build::kAuto) {
    const auto stored = Upload(test::OffBytes(mesh), build);
    EXPECT_TRUE(stored.ok());
    const auto built = backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(2),
                                          CancelToken());
    EXPECT_TRUE(built.ok() && built->ready);
    return stored->id;
  }

  api::Outcome<api::TreeDescription> DescribeNow(std::string_view id) {
    return backend_->Describe(id, steady_clock::now(), CancelToken());
  }

  // One request: acquires the tree, asks it once, and lets it go.
  api::Outcome<ClosestAnswer> Closest(std::string_view id, const api::RayTable& rays,
                                      const api::RayOptions& options, const CancelToken& cancel) {
    return Ask<ClosestAnswer>(id, rays, options, cancel, &LoadedTree::Closest);
  }
  api::Outcome<AnyAnswer> Any(std::string_view id, const api::RayTable& rays,
                              const api::RayOptions& options, const CancelToken& cancel) {
    return Ask<AnyAnswer>(id, rays, options, cancel, &LoadedTree::Any);
  }
  api::Outcome<CountAnswer> Count(std::string_view id, const api::RayTable& rays,
                                  const api::RayOptions& options, const CancelToken& cancel) {
    return Ask<CountAnswer>(id, rays, options, cancel, &LoadedTree::Count);
  }
  api::Outcome<AllAnswer> All(std::string_view id, const api::RayTable& rays,
                              const api::RayOptions& options, const CancelToken& cancel) {
    return Ask<AllAnswer>(id, rays, options, cancel, &LoadedTree::All);
  }
  template <class Answer, class Method>
  api::Outcome<Answer> Ask(std::string_view id, const api::RayTable& rays,
                           const api::RayOptions& options, const CancelToken& cancel,
                           Method method) {
    const auto tree = backend_->Acquire(id, TreeUse::kRays, cancel);
    if (!tree) return tree.problem();
    Answer answer;
    auto report = ((**tree).*method)(rays, options, cancel, answer.rows.get());
    if (!report) return report.problem();
    answer.report = *std::move(report);
    return answer;
  }
  api::Outcome<api::RenderAnswer> Render(std::string_view id, const api::RenderRequest& request,
                                         bool png, const CancelToken& cancel) {
    const auto tree =
        backend_->Acquire(id, NeedsBinaryTree(request) ? TreeUse::kCells : TreeUse::kRays, cancel);
    if (!tree) return tree.problem();
    return (*tree)->Render(request, png, cancel);
  }
  static bool NeedsBinaryTree(const api::RenderRequest& request) {
    return request.cells_depth || request.mode == api::RenderMode::kCost;
  }
  api::Outcome<std::vector<api::Cell>> Cells(std::string_view id, std::uint32_t depth,
                                             const CancelToken& cancel) {
    const auto tree = backend_->Acquire(id, TreeUse::kCells, cancel);
    if (!tree) return tree.problem();
    return (*tree)->Cells(depth, cancel);
  }

  test::SimulatedDisk disk_;
  CoreBackendOptions options_;
  std::unique_ptr<Backend> backend_;
};

core::MeshData Sphere() { return test::BumpySphere({1, 2, 3}, 2, 12, 24, 0.2); }

// Rays through and past the sphere; every 10th is invalid.
template <class T>
test::RayRows<T> SomeRays(std::size_t count) {
  std::mt19937_64 random = test::RandomEngine(4242);
  std::uniform_real_distribution<T> place(T(-5), T(9));
  std::vector<test::RayRow<T>> rows(count);
  for (std::size_t i = 0; i < count; ++i) {
    test::RayRow<T>& r = rows[i];
    r.ox = place(random);
    r.oy = place(random);
    r.oz = place(random);
    r.t_min = 0;
    r.t_max = std::numeric_limits<T>::infinity();
    r.dx = T(1) - r.ox + place(random) / T(4);
    r.dy = T(2) - r.oy + place(random) / T(4);
    r.dz = T(3) - r.oz;
    if (i % 10 == 7) r.dx = std::numeric_limits<T>::quiet_NaN();
  }
  return test::RayRows<T>(std::move(rows));
}

core::Ray RayOf(const test::RayRow<double>& r) {
  return {core::Vec3d{r.ox, r.oy, r.oz}, r.t_min, core::Vec3d{r.dx, r.dy, r.dz}, r.t_max};
}

void ExpectSame(const api::RayHit& a, const api::RayHit& b) {
  EXPECT_TRUE(a.triangle == b.triangle && a.u == b.u && a.v == b.v &&
              (a.t == b.t || (std::isnan(a.t) && std::isnan(b.t))));
}

TEST_F(CoreBackendTest, AnUploadIsDescribedAndItsBytesComeBack) {
  const MeshBytesVector bytes = test::OffBytes(Sphere());
  const std::string sha256 = core::HashBytes(bytes).ToHex();
  const auto stored = Upload(bytes, api::Build::kKdBinned);
  ASSERT_TRUE(stored.ok());
  EXPECT_EQ(stored->id, sha256 + "-kd-binned");
  EXPECT_FALSE(stored->existed);
  const auto description =
      backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(2), CancelToken());
  ASSERT_TRUE(description.ok());
  EXPECT_TRUE(description->ready);
  EXPECT_EQ(description->progress, 1.0);
  EXPECT_EQ(description->mesh.sha256, sha256);
  EXPECT_EQ(description->mesh.format, api::MeshFormat::kOff);
  EXPECT_EQ(description->mesh.bytes, bytes.size());
  EXPECT_EQ(description->mesh.triangles, Sphere().triangles.size());
  EXPECT_TRUE(description->mesh.health.closed);
  ASSERT_TRUE(description->tree.has_value());
  EXPECT_EQ(description->tree->build, api::Build::kKdBinned);
  EXPECT_THAT(description->plan, HasSubstr("kd-binned"));
  EXPECT_TRUE(Upload(bytes, api::Build::kKdBinned)->existed);

  const auto mesh = backend_->OpenMesh(stored->id, {});
  ASSERT_TRUE(mesh.ok());
  MeshBytesVector read((*mesh)->size());
  ASSERT_TRUE((*mesh)->Read(0, read));
  EXPECT_EQ(read, bytes);
  EXPECT_FALSE((*mesh)->Read(read.size(), std::span(read).first(1))) << "beyond the end";
}

TEST_F(CoreBackendTest, WhatIsNoIdIsNotFoundEverywhere) {
  const std::string real = Add(Sphere());
  for (const std::string& id :
       {std::string(), std::string("x"), std::string("../") + real, real + "x", real.substr(0, 64),
        real.substr(0, 65), std::string(64, 'g') + "-auto", std::string(64, 'A') + "-auto",
        std::string(64, '0') + "-auto", real.substr(0, 65) + "octree", real + std::string(1, '\0'),
        std::string(5000, 'a')}) {
    EXPECT_EQ(DescribeNow(id).problem().code, ErrorCode::kTreeNotFound) << id;
    EXPECT_EQ(backend_->Delete(id)->code, ErrorCode::kTreeNotFound);
    EXPECT_EQ(backend_->OpenMesh(id, {}).problem().code, ErrorCode::kTreeNotFound);
    EXPECT_EQ(Closest(id, SomeRays<double>(1).table(), {}, Soon()).problem().code,
              ErrorCode::kTreeNotFound);
    EXPECT_EQ(Any(id, SomeRays<double>(1).table(), {}, Soon()).problem().code,
              ErrorCode::kTreeNotFound);
    EXPECT_EQ(Render(id, {}, true, Soon()).problem().code, ErrorCode::kTreeNotFound);
    EXPECT_EQ(Cells(id, 0, Soon()).problem().code, ErrorCode::kTreeNotFound);
  }
}

TEST_F(CoreBackendTest, AnotherBuildOfAStoredMesh) {
  const std::string id = Add(Sphere());
  const std::string sha256 = id.substr(0, 64);
  const auto stored = backend_->BuildStored(sha256, api::Build::kBvh);
  ASSERT_TRUE(stored.ok());
  EXPECT_EQ(stored->id, sha256 + "-bvh");
  EXPECT_FALSE(stored->existed);
  for (const std::string& unknown : {std::string(64, '0'), std::string("x"), sha256 + "0"}) {
    EXPECT_EQ(backend_->BuildStored(unknown, api::Build::kBvh).problem().code,
              ErrorCode::kMeshNotFound);
  }
}

TEST_F(CoreBackendTest, BrokenMeshesAnswerTheirProblemWithItsLine) {
  const auto stored = Upload(test::Bytes("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"));
  ASSERT_TRUE(stored.ok());
  const auto waited =
      backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(2), CancelToken());
  ASSERT_FALSE(waited.ok());
  EXPECT_EQ(waited.problem().code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(waited.problem().line, 6u);
  EXPECT_EQ(DescribeNow(stored->id).problem().code, ErrorCode::kInvalidMesh);
  EXPECT_EQ(Closest(stored->id, SomeRays<double>(1).table(), {}, Soon()).problem().code,
            ErrorCode::kInvalidMesh);
  EXPECT_EQ(Upload({}).problem().code, ErrorCode::kEmptyMesh);
}

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
      ExpectSame(hits[i], ToApi(expected));
    }
    EXPECT_GT(hit_count, 500u);
    EXPECT_EQ(answer->report.invalid, invalid);
    EXPECT_GT(answer->report.trace_ms, 0);
  }
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

TEST_F(CoreBackendTest, AQueryOnATreeThatIsBuiltWaitsItsDeadlineOutAndIsToldToComeAgain) {
  // Large enough that it is not built at once.
  const auto stored = Upload(test::OffBytes(test::UvSphere({0, 0, 0}, 1, 80, 160)));
  ASSERT_TRUE(stored.ok());
  const auto building = DescribeNow(stored->id);
  ASSERT_TRUE(building.ok());
  const auto hasty = Closest(stored->id, SomeRays<double>(1).table(), {},
                             CancelToken::WithDeadline(steady_clock::now() + milliseconds(1)));
  // The build may end just after the deadline.
  const bool built_late = !hasty.ok() && hasty.problem().code == ErrorCode::kDeadlineExceeded;
  EXPECT_TRUE(!built_late || DescribeNow(stored->id)->ready);
  if (!building->ready && !hasty.ok() && !built_late) {
    EXPECT_EQ(hasty.problem().code, ErrorCode::kTreeBuilding);
    EXPECT_THAT(hasty.problem().detail, HasSubstr("percent of the work is done"));
    EXPECT_LT(building->progress, 1.0);
    EXPECT_FALSE(building->tree.has_value());
    EXPECT_EQ(building->mesh.sha256, stored->id.substr(0, 64));
  }
  EXPECT_TRUE(Closest(stored->id, SomeRays<double>(1).table(), {}, Soon()).ok());
}

TEST_F(CoreBackendTest, AnAcquiredTreeAnswersAfterItWasDeleted) {
  const std::string id = Add(Sphere());
  EXPECT_EQ(backend_->Find(id), std::nullopt);
  const auto tree = backend_->Acquire(id, TreeUse::kRays, Soon());
  ASSERT_TRUE(tree.ok());
  const auto ask = [&] {
    test::Collected<api::ClosestRows> rows;
    EXPECT_TRUE((*tree)->Closest(SomeRays<double>(100).table(), {}, Soon(), &rows).ok());
    return rows.hits;
  };
  const std::vector<api::RayHit> before = ask();
  EXPECT_EQ(backend_->Delete(id), std::nullopt);
  EXPECT_EQ(backend_->Find(id)->code, ErrorCode::kTreeNotFound);
  EXPECT_EQ(backend_->Acquire(id, TreeUse::kRays, Soon()).problem().code, ErrorCode::kTreeNotFound);
  const std::vector<api::RayHit> after = ask();
  for (std::size_t i = 0; i < 100; ++i) {
    EXPECT_EQ(after[i].triangle, before[i].triangle) << i;
  }
}

TEST_F(CoreBackendTest, RendersAPngAndArrays) {
  const std::string id = Add(Sphere());
  api::RenderRequest request;
  request.width = 40;
  request.height = 30;
  const auto png = Render(id, request, true, Soon());
  ASSERT_TRUE(png.ok());
  const auto& bytes = std::get<std::vector<std::byte>>(png->image);
  ASSERT_GT(bytes.size(), 8u);
  EXPECT_EQ(std::to_integer<int>(bytes[1]), 'P');
  EXPECT_GT(png->trace_ms, 0);
  EXPECT_GT(png->encode_ms, 0);
  const std::pair<api::RenderMode, std::size_t> channels[] = {
      {api::RenderMode::kShaded, 4}, {api::RenderMode::kNormal, 3},
      {api::RenderMode::kDepth, 1},  {api::RenderMode::kTriangle, 1},
      {api::RenderMode::kCost, 2},   {api::RenderMode::kPosition, 3}};
  for (const auto& [mode, count] : channels) {
    request.mode = mode;
    const auto array = Render(id, request, false, Soon());
    ASSERT_TRUE(array.ok());
    const auto& image = std::get<api::ImageArray>(array->image);
    EXPECT_EQ(image.width, 40u);
    EXPECT_EQ(image.height, 30u);
    EXPECT_EQ(image.channels, count);
    std::visit([&](const auto& values) { EXPECT_EQ(values.size(), 40u * 30u * count); },
               image.values);
    const bool is_integer = mode == api::RenderMode::kTriangle || mode == api::RenderMode::kCost;
    const bool is_double = mode == api::RenderMode::kPosition;
    EXPECT_EQ(image.values.index(), is_integer ? 1u : is_double ? 2u : 0u);
  }
}

TEST_F(CoreBackendTest, EdgesOfAPolygonAreDrawnWithoutItsDiagonals) {
  const auto light_at = [&](std::string_view faces, int x, int y) {
    const std::string off = "OFF\n4 " + std::string(faces.size() > 10 ? "2" : "1") +
                            " 0\n-1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n" + std::string(faces);
    MeshBytesVector bytes(off.size());
    std::memcpy(bytes.data(), off.data(), off.size());
    const auto stored = Upload(bytes, api::Build::kAuto);
    EXPECT_TRUE(stored.ok());
    EXPECT_TRUE(
        backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(1), {}).ok());
    api::RenderRequest request;
    request.width = request.height = 41;
    request.projection = api::Projection::kOrthographic;
    request.view = api::View::kFront;
    request.edges = true;
    const auto array = Render(stored->id, request, false, Soon());
    EXPECT_TRUE(array.ok()) << array.problem().detail;
    const auto& image = std::get<api::ImageArray>(array->image);
    return std::get<std::vector<float>>(image.values)[static_cast<std::size_t>(4 * (41 * y + x))];
  };
  const std::string_view polygon = "4 0 1 2 3\n", triangles = "3 0 1 2\n3 0 2 3\n";
  EXPECT_LT(light_at(triangles, 20, 20), 0.5F * light_at(polygon, 20, 20)) << "the diagonal";
  EXPECT_EQ(light_at(triangles, 10, 20), light_at(polygon, 10, 20)) << "beside it";
  EXPECT_EQ(backend_->counters().attribute_reads, 2u) << "once for each file";
}

TEST_F(CoreBackendTest, ColoursAndNormalsOfTheFileAreUsedWhereTheyAreNamed) {
  // Red vertices, whose normals are turned by 60 degrees from the triangle's own.
  const std::string obj =
      "v -1 -1 0 1 0 0\nv 1 -1 0 1 0 0\nv 0 1 0 1 0 0\nvn 0.8660254037844386 0 0.5\n"
      "f 1//1 2//1 3//1\n";
  MeshBytesVector bytes(obj.size());
  std::memcpy(bytes.data(), obj.data(), obj.size());
  const auto stored = Upload(bytes, api::Build::kAuto);
  ASSERT_TRUE(stored.ok());
  ASSERT_TRUE(
      backend_->Describe(stored->id, steady_clock::now() + std::chrono::minutes(1), {}).ok());
  api::RenderRequest request;
  request.width = request.height = 21;
  request.projection = api::Projection::kOrthographic;
  request.view = api::View::kFront;
  request.color = {1, 1, 1};
  const auto middle = [&] {
    const auto array = Render(stored->id, request, false, Soon());
    EXPECT_TRUE(array.ok()) << array.problem().detail;
    const auto& values =
        std::get<std::vector<float>>(std::get<api::ImageArray>(array->image).values);
    const float* pixel = values.data() + std::size_t{4} * (21 * 10 + 10);
    return std::array<float, 3>{pixel[0], pixel[1], pixel[2]};
  };
  const auto plain = middle();
  EXPECT_EQ(backend_->counters().attribute_reads, 0u);
  request.smooth = true;
  const auto smooth = middle();
  request.file_color = true;
  const auto red = middle();
  EXPECT_EQ(plain[0], plain[1]);
  EXPECT_NEAR(smooth[0], 0.5F * plain[0], 1e-3F) << "the cosine of 60 degrees";
  EXPECT_NEAR(red[0], smooth[0], 1e-3F);
  EXPECT_EQ(red[1], 0.0F);
  EXPECT_EQ(red[2], 0.0F);
}

TEST_F(CoreBackendTest, RegionsOfADepthPictureHaveTheRangeOfTheWhole) {
  const std::string id = Add(Sphere());
  api::RenderRequest request;
  request.width = 40;
  request.height = 30;
  request.mode = api::RenderMode::kDepth;
  const auto array = Render(id, request, false, Soon());
  ASSERT_TRUE(array.ok());
  EXPECT_FALSE(array->depth_range) << "an array has no greys";
  double near = HUGE_VAL, far = 0;
  for (const float depth :
       std::get<std::vector<float>>(std::get<api::ImageArray>(array->image).values)) {
    if (std::isinf(depth)) continue;
    near = std::min(near, static_cast<double>(depth));
    far = std::max(far, static_cast<double>(depth));
  }
  using Range = std::array<double, 2>;
  EXPECT_EQ(Render(id, request, true, Soon())->depth_range, (Range{near, far}));
  request.region = api::Region{18, 12, 22, 16};
  EXPECT_EQ(Render(id, request, true, Soon())->depth_range, (Range{near, far}));
  request.depth_range = {1, 2};
  EXPECT_EQ(Render(id, request, true, Soon())->depth_range, (Range{1, 2}));
  request.depth_range.reset();
  request.eye = api::Vec3{1, 2, 99};
  request.target = api::Vec3{1, 2, 199};
  EXPECT_EQ(Render(id, request, true, Soon())->depth_range, std::nullopt) << "nothing is hit";
}

TEST_F(CoreBackendTest, ACameraThatCannotBeIsAnInvalidParameter) {
  const std::string id = Add(Sphere());
  api::RenderRequest request;
  request.eye = api::Vec3{1, 2, 3};
  request.target = api::Vec3{1, 2, 3};
  const auto answer = Render(id, request, true, Soon());
  ASSERT_FALSE(answer.ok());
  EXPECT_EQ(answer.problem().code, ErrorCode::kInvalidParameter);
  EXPECT_TRUE(answer.problem().parameter.has_value()) << answer.problem().detail;
}

TEST_F(CoreBackendTest, CellsAreInWorldUnitsAndLimited) {
  const std::string id = Add(Sphere());
  const auto root = Cells(id, 0, Soon());
  ASSERT_TRUE(root.ok());
  ASSERT_EQ(root->size(), 1u);
  const auto description = DescribeNow(id);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR((*root)[0].bounds.min[axis], description->mesh.bounds.min[axis], 1e-5);
    EXPECT_NEAR((*root)[0].bounds.max[axis], description->mesh.bounds.max[axis], 1e-5);
  }
  EXPECT_FALSE((*root)[0].leaf);
  options_.limits.max_cells = 10;
  Open();
  EXPECT_LE(Cells(id, 3, Soon())->size(), 8u);
  const auto many = Cells(id, 10, Soon());
  ASSERT_FALSE(many.ok());
  EXPECT_EQ(many.problem().code, ErrorCode::kTooManyCells);
  EXPECT_EQ(many.problem().limit, 10.0);
}

TEST_F(CoreBackendTest, APictureOfTooManyCellsSaysSoAndHowManyItDraws) {
  options_.limits.max_picture_cells = 8;
  Open();
  const std::string id = Add(Sphere());
  api::RenderRequest request;
  request.width = request.height = 8;
  request.cells_depth = 3;
  EXPECT_TRUE(Render(id, request, true, Soon()).ok());
  EXPECT_EQ(backend_->counters().binary_rebuilds, 1u);
  EXPECT_TRUE(Cells(id, 3, Soon()).ok());
  EXPECT_EQ(backend_->counters().binary_rebuilds, 1u) << "pictures and lists share it";
  request.cells_depth = 10;
  const auto many = Render(id, request, true, Soon());
  ASSERT_FALSE(many.ok());
  EXPECT_EQ(many.problem().code, ErrorCode::kTooManyCells);
  EXPECT_EQ(many.problem().parameter, "cells_depth");
  EXPECT_EQ(many.problem().limit, 8.0);
}

TEST_F(CoreBackendTest, PagesOfTheListJoinWithoutGaps) {
  std::vector<std::string> ids;
  for (int i = 0; i < 5; ++i) ids.push_back(Add(test::Cube({double(i), 0, 0}, 1)));
  std::vector<std::string> listed;
  std::string after;
  for (int pages = 0; pages < 10; ++pages) {
    const auto page = backend_->List("", 2, after);
    ASSERT_TRUE(page.ok());
    for (const auto& tree : page->trees) listed.push_back(tree.id);
    if (!page->next) break;
    after = *page->next;
  }
  EXPECT_THAT(listed, testing::UnorderedElementsAreArray(ids));
  EXPECT_FALSE(backend_->List("", 5, "")->next.has_value()) << "all of them fit";
  const auto one = backend_->List(ids[2].substr(0, 64), 10, "");
  ASSERT_EQ(one->trees.size(), 1u);
  EXPECT_EQ(one->trees[0].id, ids[2]);
  EXPECT_TRUE(backend_->List(std::string(64, '0'), 10, "")->trees.empty());
  for (const std::string& bad : {std::string("x"), std::string("1"), after + "x"}) {
    const auto refused = backend_->List("", 2, bad);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.problem().code, ErrorCode::kInvalidParameter);
    EXPECT_EQ(refused.problem().parameter, "after");
  }
}

TEST_F(CoreBackendTest, AnswersAreTheSameBytesFromMemoryDiskAndEveryThreadCount) {
  const std::string id = Add(Sphere());
  const test::RayRows<double> rays = SomeRays<double>(20'000);
  const auto before = Closest(id, rays.table(), {}, Soon());
  ASSERT_TRUE(before.ok());
  for (const int threads : {1, 2, 5}) {
    options_.threads = threads;
    Open();
    const auto after = Closest(id, rays.table(), {}, Soon());
    ASSERT_TRUE(after.ok());
    for (std::size_t i = 0; i < rays.table().size(); ++i) {
      ExpectSame(before->rows->hits[i], after->rows->hits[i]);
    }
    EXPECT_EQ(backend_->counters().builds, 0u);
    EXPECT_EQ(backend_->counters().loads, 1u);
  }
}

TEST_F(CoreBackendTest, AFullDiskIsStoreFullAndWhatIsInMemoryIsServed) {
  const std::string id = Add(Sphere());
  disk_.set_read_only(true);
  EXPECT_EQ(backend_->BeginUpload(100).problem().code, ErrorCode::kStoreFull);
  EXPECT_TRUE(Closest(id, SomeRays<double>(10).table(), {}, Soon()).ok());
  EXPECT_EQ(backend_->Delete(id)->code, ErrorCode::kStoreFull);
}

TEST_F(CoreBackendTest, ShutdownEndsWaitsAndAnswersDraining) {
  const auto stored = Upload(test::OffBytes(test::UvSphere({0, 0, 0}, 1, 80, 160)));
  ASSERT_TRUE(stored.ok());
  std::thread client([&] {
    const auto waited = backend_->Describe(
        stored->id, steady_clock::now() + std::chrono::minutes(2), CancelToken());
    EXPECT_TRUE(waited.ok() || waited.problem().code == ErrorCode::kDraining);
  });
  const auto start = steady_clock::now();
  backend_->Shutdown();
  client.join();
  EXPECT_LT(steady_clock::now() - start, std::chrono::seconds(20));
  Open();
  EXPECT_TRUE(Closest(stored->id, SomeRays<double>(1).table(), {}, Soon()).ok()) << "resumed";
}

TEST(MakeCoreBackend, RefusesOptionsThatCannotBeAndASecondDaemon) {
  test::SimulatedDisk disk;
  CoreBackendOptions options;
  options.data_dir = "data";
  options.file_system = &disk;
  options.threads = 0;
  EXPECT_EQ(MakeCoreBackend(options).error().code, core::ErrorCode::kInvalidArgument);
  options.threads = 1;
  const auto first = MakeCoreBackend(options);
  ASSERT_TRUE(first.ok());
  const auto second = MakeCoreBackend(options);
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.error().code, core::ErrorCode::kInvalidArgument);
}

}  // namespace
}  // namespace kdray::server
