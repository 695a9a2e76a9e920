#include "core/kernel/scalar_search.h"

#include <new>
#include <type_traits>

#include "core/geometry/local_ray.h"
#include "core/intersect/closest_search.h"

namespace kdray::core {

namespace {

template <class Intersection, class CornersOf>
class ScalarSearchOf final : public ScalarSearch {
 public:
  explicit ScalarSearchOf(const CornersOf& corners) : corners_(corners) {}

  std::optional<LocalRay> MakeRay(const Ray& ray, const MeshFrame& frame) const override {
    return Intersection::MakeRay(ray, frame);
  }
  void Begin(const LocalRay& ray, ScalarSearchSpace* space) const override {
    static_assert(sizeof(Search) <= sizeof(ScalarSearchSpace) &&
                  std::is_trivially_destructible_v<Search>);
    new (space->bytes) Search(ray);
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
  Hit Closest(const LocalRay& ray, const WideTree& tree, CancelPoll* poll) const override {
    const Intersection test(ray);
    ClosestSearch<Intersection> closest;
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
    explicit Search(const LocalRay& ray) : given(*ray.given), local(ray), test(local) {
      local.given = &given;
    }
    Ray given;
    LocalRay local;
    Intersection test;
    ClosestSearch<Intersection> closest;
  };
  static const Search& SearchIn(const ScalarSearchSpace& space) {
    return *std::launder(reinterpret_cast<const Search*>(space.bytes));
  }

  CornersOf corners_;
};

}  // namespace

std::unique_ptr<const ScalarSearch> MakeScalarSearch(const TriangleMesh& mesh,
                                                     Precision precision) {
  return VisitIntersection(
      mesh, precision,
      [&]<class CornersOf, class Test>(
          const CornersOf& corners, IntersectionTag<Test>) -> std::unique_ptr<const ScalarSearch> {
        return std::make_unique<ScalarSearchOf<Test, CornersOf>>(corners);
      });
}

}  // namespace kdray::core
