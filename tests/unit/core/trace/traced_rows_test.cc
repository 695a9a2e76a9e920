// SPDX-License-Identifier: Apache-2.0
// TraceOptions::traced gets each row once, when its answer is final.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "core/base/parallel.h"
#include "core/scene/scene.h"
#include "core/trace/trace.h"
#include "core/tradeoff/ray_sets.h"
#include "tests/support/scenes.h"
#include "tests/support/shapes.h"

namespace kdray {
namespace {

using core::Hit;
using core::Ray;

// Some blocks, and a last one that is not full.
constexpr std::size_t kRays = 5 * core::kTracedRows + 100;

class TracedRows : public testing::Test {
 protected:
  TracedRows()
      : scene_(test::MakeScene(test::BumpySphere({}, 1, 40, 40, 0.1), core::BuildKind::kBvh)),
        rays_(core::RandomRays(*scene_.mesh, kRays, 7)) {}

  /// Calls trace(options, answers), whose answers must be those at the time of traced().
  template <class Answer, class Trace>
  void ExpectEachRowOnceAndFinal(core::TraceOptions options, const Trace& trace) {
    std::vector<Answer> answers(kRays), seen(kRays);
    std::vector<int> calls(kRays);
    std::mutex mutex;
    options.traced = [&](std::size_t first, std::size_t last) {
      const std::lock_guard lock(mutex);
      for (std::size_t row = first; row < last; ++row) {
        ++calls[row];
        seen[row] = answers[row];
      }
    };
    core::Arena arena(2);
    arena.Run([&] { ASSERT_TRUE(trace(options, answers).ok()); });
    EXPECT_EQ(std::ranges::count(calls, 1), static_cast<std::ptrdiff_t>(kRays));
    EXPECT_EQ(seen, answers);
  }

  const core::Scene scene_;
  const std::vector<Ray> rays_;
};

TEST_F(TracedRows, AreEachReportedOnceWithTheirFinalAnswers) {
  for (const std::optional<bool> sort : {std::optional<bool>(false), std::optional<bool>(true)}) {
    for (const bool ends_on_surface : {false, true}) {
      core::TraceOptions options;
      options.sort = sort;
      options.ends_on_surface = ends_on_surface;
      ExpectEachRowOnceAndFinal<Hit>(options, [&](const auto& given, std::span<Hit> hits) {
        return core::TraceClosest(scene_, std::span<const Ray>(rays_), given, hits);
      });
      ExpectEachRowOnceAndFinal<std::uint8_t>(
          options, [&](const auto& given, std::span<std::uint8_t> occluded) {
            return core::TraceAny(scene_, std::span<const Ray>(rays_), given, occluded);
          });
      ExpectEachRowOnceAndFinal<std::uint32_t>(
          options, [&](const auto& given, std::span<std::uint32_t> counts) {
            return core::TraceCount(scene_, std::span<const Ray>(rays_), given, counts);
          });
    }
  }
}

}  // namespace
}  // namespace kdray
