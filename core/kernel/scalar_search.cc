// SPDX-License-Identifier: Apache-2.0
#include "core/kernel/scalar_search.h"

#include <algorithm>
#include <new>
#include <type_traits>
#include <vector>

#include "core/base/polled_sort.h"
#include "core/geometry/local_ray.h"
#include "core/intersect/closest_search.h"

namespace kdray::core {

namespace {

template <class Intersection, class CornersOf>
class ScalarSearchOf final : public ScalarSearch {
 public:
  ScalarSearchOf(const CornersOf& corners, const HitFilter* filter)
      : corners_(corners), filter_(filter) {}

  std::optional<LocalRay> MakeRay(const Ray& ray, const MeshFrame& frame) const override {
    return Intersection::MakeRay(ray, frame);
  }
  void Begin(const LocalRay& ray, ScalarSearchSpace* space) const override {
    static_assert(sizeof(Search) <= sizeof(ScalarSearchSpace) &&
                  std::is_trivially_destructible_v<Search>);
    new (space->bytes) Search(ray, filter_);
  }
  bool Offer(PrimitiveId id, ScalarSearchSpace* space) const override {
    Search& search = *std::launder(reinterpret_cast<Search*>(space->bytes));
    return search.closest.Offer(search.test, id, corners_);
  }
  double Limit(const ScalarSearchSpace& space) const override {
    return SearchIn(space).closest.limit;
  }
  Hit Finish(const ScalarSearchSpace& space) const override {
    const Search& search = SearchIn(space);
    return search.closest.Finish(search.test, corners_);
  }
  bool Crosses(PrimitiveId id, ScalarSearchSpace* space) const override {
    const Intersection& test = SearchIn(*space).test;
    const auto [a, b, c] = corners_(id);
    typename Intersection::Hit hit;
    return test.Test(a, b, c, &hit) && test.OwnsCrossing(a, b, c, hit) &&
           test.IsInInterval(hit, id, corners_);
  }
  Hit Answer(PrimitiveId id, ScalarSearchSpace* space) const override {
    return SearchIn(*space).test.Finish(Tested(id, *space), id, corners_);
  }
  void OrderTies(std::span<Hit> hits, ScalarSearchSpace* space, CancelPoll* poll) const override {
    const Intersection& test = SearchIn(*space).test;
    struct Tie {
      Hit answer;
      typename Intersection::Hit hit;
    };
    std::vector<Tie> ties;
    ties.reserve(hits.size());
    for (const Hit& answer : hits) {
      if (poll->Spend(Intersection::kWork)) return;
      ties.push_back({answer, Tested(answer.primitive_id, *space)});
    }
    PolledSort(std::span(ties), Intersection::kWork, poll, [&](const Tie& a, const Tie& b) {
      return test.IsCloser(a.hit, a.answer.primitive_id, b.hit, b.answer.primitive_id, corners_);
    });
    std::transform(ties.begin(), ties.end(), hits.begin(),
                   [](const Tie& tie) { return tie.answer; });
  }
  Hit Closest(const LocalRay& ray, const WideTree& tree, CancelPoll* poll) const override {
    const Intersection test(ray);
    ClosestSearch<Intersection> closest{.filter = {filter_, ray.given}};
    tree.Traverse(
        ray, test.pad(),
        [&](std::span<const PrimitiveId> ids) {
          poll->Spend(ids.size() * Intersection::kWork);
          for (const PrimitiveId id : ids) closest.Offer(test, id, corners_);
          return closest.limit;
        },
        [&] { return !poll->Spend(kNodeWork); });
    return closest.Finish(test, corners_);
  }
  std::uint64_t work() const override { return Intersection::kWork; }
  bool Test(const LocalRay& ray, PrimitiveId id, TriangleHit* hit) const override {
    if constexpr (std::is_same_v<typename Intersection::Hit, TriangleHit>) {
      const auto [a, b, c] = corners_(id);
      return Intersection(ray).Test(a, b, c, hit);
    } else {
      return false;
    }
  }

 private:
  struct Search {
    Search(const LocalRay& ray, const HitFilter* filter)
        : given(*ray.given), local(ray), test(local), closest{.filter = {filter, &given}} {
      local.given = &given;
    }
    Ray given;
    LocalRay local;
    Intersection test;
    ClosestSearch<Intersection> closest;
  };
  typename Intersection::Hit Tested(PrimitiveId id, const ScalarSearchSpace& space) const {
    const auto [a, b, c] = corners_(id);
    typename Intersection::Hit hit{};
    SearchIn(space).test.Test(a, b, c, &hit);
    return hit;
  }
  static const Search& SearchIn(const ScalarSearchSpace& space) {
    return *std::launder(reinterpret_cast<const Search*>(space.bytes));
  }

  CornersOf corners_;
  const HitFilter* filter_;
};

}  // namespace

std::unique_ptr<const ScalarSearch> MakeScalarSearch(const TriangleMesh& mesh, Precision precision,
                                                     const HitFilter* filter) {
  return VisitIntersection(
      mesh, precision,
      [&]<class CornersOf, class Test>(
          const CornersOf& corners, IntersectionTag<Test>) -> std::unique_ptr<const ScalarSearch> {
        return std::make_unique<ScalarSearchOf<Test, CornersOf>>(corners, filter);
      });
}

}  // namespace kdray::core
