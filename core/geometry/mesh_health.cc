// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/mesh_health.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <span>
#include <tuple>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/polled_sort.h"

namespace kdray::core {
namespace {

// Values by key, for one slice of keys at a time, so the largest slice bounds the memory. The
// values of key k are values[start[k]] up to values[start[k + 1]].
template <class Value>
class Groups {
 public:
  /// for_each(emit) must make the same calls emit(key, value) each time; key < keys. It may end
  /// early when a poll has stopped; the groups are then invalid.
  template <class ForEach>
  Groups(std::size_t keys, const ForEach& for_each) : start_(keys + 1) {
    for_each([&](std::size_t key, Value) { ++start_[key]; });
  }

  std::size_t keys() const { return start_.size() - 1; }
  /// Valid before the key was in a slice.
  std::size_t CountOf(std::size_t key) const { return start_[key]; }

  /// Gathers the values of the keys from `first` on, at most `most` values, but at least one key;
  /// returns the first key after them. Call it once for each key, in order.
  template <class ForEach>
  std::size_t Gather(std::size_t first, std::size_t most, const ForEach& for_each) {
    std::size_t last = first;
    std::size_t count = 0;
    while (last < keys() && (last == first || count + start_[last] <= most)) {
      count += start_[last];
      start_[last] = static_cast<std::uint32_t>(count);
      ++last;
    }
    // A growing vector would hold two arrays at once.
    if (values_.capacity() < count) values_ = std::vector<Value>();
    values_.resize(count);
    last_ = last;
    for_each([&](std::size_t key, Value value) {
      // From the end of the group down to its start.
      if (key >= first && key < last) values_[--start_[key]] = value;
    });
    return last;
  }

  /// The values of a key of the slice.
  std::span<Value> operator[](std::size_t key) {
    const std::size_t end = key + 1 < last_ ? start_[key + 1] : values_.size();
    return std::span(values_).subspan(start_[key], end - start_[key]);
  }

 private:
  std::vector<std::uint32_t> start_;  // counts, until the key is in a slice
  std::vector<Value> values_;
  std::size_t last_ = 0;  // of the slice
};

// Equal values get neighbours; visit(first, last) is called for each run of values that `same`
// holds for.
template <class Value, class Same, class Visit>
void ForEachRun(std::span<const Value> values, const Same& same, const Visit& visit) {
  for (std::size_t first = 0, last = 0; first < values.size(); first = last) {
    while (last < values.size() && same(values[first], values[last])) ++last;
    visit(values.subspan(first, last - first));
  }
}

std::uint64_t HashPosition(const Vec3d& p) {
  std::uint64_t hash = 0;
  for (const double coordinate : {p.x, p.y, p.z}) {
    // + 0.0 makes -0 the same as +0. Multiplication by an odd constant, high bits folded down.
    hash = (hash ^ std::bit_cast<std::uint64_t>(coordinate + 0.0)) * 0x9e3779b97f4a7c15u;
    hash ^= hash >> 32;
  }
  return hash;
}

// For each vertex that triangles use, the first vertex at the same position. Hashed into small
// groups and sorted in each, so that positions chosen to collide cost O(n log n) too.
template <class T>
std::vector<std::uint32_t> JoinPositions(std::span<const Vec3<T>> vertices,
                                         std::span<const TriangleIndices> triangles,
                                         CancelPoll* poll) {
  std::vector<bool> used(vertices.size());
  PolledLoop(triangles.size(), 8, poll, [&](std::size_t id) {
    for (const std::uint32_t index : triangles[id]) used[index] = true;
  });
  const std::size_t keys = std::bit_ceil(vertices.size() / 4 + 1);
  const auto for_each = [&](const auto& emit) {
    PolledLoop(vertices.size(), 16, poll, [&](std::size_t i) {
      if (used[i]) {
        emit(HashPosition(Vec3d(vertices[i])) & (keys - 1), static_cast<std::uint32_t>(i));
      }
    });
  };
  std::vector<std::uint32_t> joined(vertices.size());
  Groups<std::uint32_t> groups(keys, for_each);
  groups.Gather(0, vertices.size(), for_each);
  const auto less = [&](std::uint32_t a, std::uint32_t b) {
    const Vec3<T>& p = vertices[a];
    const Vec3<T>& q = vertices[b];
    return std::tie(p.x, p.y, p.z, a) < std::tie(q.x, q.y, q.z, b);
  };
  for (std::size_t key = 0; key < keys && !poll->Spend(8); ++key) {
    const std::span<std::uint32_t> group = groups[key];
    if (!PolledSortInPlace(group, 8, poll, less)) break;
    ForEachRun(
        std::span<const std::uint32_t>(group),
        [&](std::uint32_t a, std::uint32_t b) { return vertices[a] == vertices[b]; },
        [&](std::span<const std::uint32_t> run) {
          for (const std::uint32_t index : run) joined[index] = run[0];
        });
  }
  return joined;
}

// Classifies an edge by the triangle sides between its two vertices.
class EdgeCounter {
 public:
  explicit EdgeCounter(MeshHealth* health) : health_(health) {}

  /// Adds an edge with this many sides in each direction.
  void Add(std::size_t forward, std::size_t backward) {
    const std::size_t sides = forward + backward;
    if (sides == 1) ++health_->open_edges;
    if (sides > 2) ++health_->non_manifold_edges;
    all_paired_ = all_paired_ && forward == 1 && backward == 1;
    any_ = true;
  }
  bool closed() const { return any_ && all_paired_; }

 private:
  MeshHealth* health_;
  bool any_ = false;
  bool all_paired_ = true;
};

// For a vertex with very many sides: its edges are counted, not gathered.
template <class ForEach>
void CountEdgesOf(std::size_t vertex, std::size_t vertices, const ForEach& for_each,
                  CancelPoll* poll, EdgeCounter* edges) {
  constexpr std::uint8_t kEnough = 3;  // larger counts are equivalent
  std::vector<std::uint8_t> sides[2] = {std::vector<std::uint8_t>(vertices),
                                        std::vector<std::uint8_t>(vertices)};
  for_each([&](std::size_t key, std::uint64_t value) {
    if (key != vertex) return;
    std::uint8_t& count = sides[value % 2][value / 2];
    if (count < kEnough) ++count;
  });
  PolledLoop(vertices, 2, poll, [&](std::size_t other) {
    const std::size_t forward = sides[1][other];
    const std::size_t backward = sides[0][other];
    if (forward + backward != 0) edges->Add(forward, backward);
  });
}

void CountEdges(const TriangleMesh& mesh, const std::vector<std::uint32_t>& joined,
                CancelPoll* poll, MeshHealth* health) {
  // Each side of a triangle, keyed by its smaller vertex: the larger vertex, and whether the side
  // runs from the smaller to the larger.
  const std::span<const TriangleIndices> triangles = mesh.triangles();
  const auto for_each = [&](const auto& emit) {
    PolledLoop(triangles.size(), 32, poll, [&](std::size_t id) {
      if (mesh.IsDegenerate(static_cast<PrimitiveId>(id))) return;
      const TriangleIndices& triangle = triangles[id];
      for (std::size_t corner = 0; corner < 3; ++corner) {
        const std::uint64_t from = joined[triangle[corner]];
        const std::uint64_t to = joined[triangle[(corner + 1) % 3]];
        emit(std::min(from, to), 2 * std::max(from, to) + (from < to ? 1 : 0));
      }
    });
  };
  // A third of the sides at a time.
  const std::size_t most = triangles.size() - mesh.degenerate_count();
  EdgeCounter edges(health);
  Groups<std::uint64_t> groups(joined.size(), for_each);
  for (std::size_t first = 0; first < groups.keys() && !poll->Spend(8);) {
    if (groups.CountOf(first) > most) {
      CountEdgesOf(first, joined.size(), for_each, poll, &edges);
      ++first;
      continue;
    }
    const std::size_t last = groups.Gather(first, most, for_each);
    for (std::size_t key = first; key < last && !poll->Spend(8); ++key) {
      const std::span<std::uint64_t> group = groups[key];
      if (!PolledSortInPlace(group, 4, poll)) break;
      ForEachRun(
          std::span<const std::uint64_t>(group),
          [](std::uint64_t a, std::uint64_t b) { return a / 2 == b / 2; },
          [&](std::span<const std::uint64_t> edge) {
            const auto forward = static_cast<std::size_t>(std::count_if(
                edge.begin(), edge.end(), [](std::uint64_t s) { return s % 2 == 1; }));
            edges.Add(forward, edge.size() - forward);
          });
    }
    first = last;
  }
  health->closed = edges.closed();
}

std::uint64_t CountDuplicates(const TriangleMesh& mesh, const std::vector<std::uint32_t>& joined,
                              CancelPoll* poll) {
  const std::span<const TriangleIndices> triangles = mesh.triangles();
  const auto for_each = [&](const auto& emit) {
    PolledLoop(triangles.size(), 32, poll, [&](std::size_t id) {
      if (mesh.IsDegenerate(static_cast<PrimitiveId>(id))) return;
      const TriangleIndices& triangle = triangles[id];
      std::array<std::uint64_t, 3> corners = {joined[triangle[0]], joined[triangle[1]],
                                              joined[triangle[2]]};
      std::sort(corners.begin(), corners.end());
      emit(corners[0], corners[1] << 32 | corners[2]);
    });
  };
  Groups<std::uint64_t> groups(joined.size(), for_each);
  groups.Gather(0, triangles.size(), for_each);
  std::uint64_t duplicates = 0;
  for (std::size_t key = 0; key < groups.keys() && !poll->Spend(8); ++key) {
    const std::span<std::uint64_t> group = groups[key];
    if (!PolledSortInPlace(group, 4, poll)) break;
    ForEachRun(std::span<const std::uint64_t>(group), std::equal_to<>(),
               [&](std::span<const std::uint64_t> run) { duplicates += run.size() - 1; });
  }
  return duplicates;
}

double CoordinateResolution(const Bounds3d& bounds, bool single_precision) {
  const double largest = std::max(MaxAbs(bounds.min), MaxAbs(bounds.max));
  if (single_precision) {
    const auto value = static_cast<float>(largest);
    return static_cast<double>(std::nextafter(value, std::numeric_limits<float>::infinity()) -
                               value);
  }
  return std::nextafter(largest, std::numeric_limits<double>::infinity()) - largest;
}

}  // namespace

Result<MeshHealth> CheckHealth(const TriangleMesh& mesh, const MeshData& data,
                               const CancelToken& cancel) {
  CancelPoll poll(cancel);
  MeshHealth health;
  health.degenerate = mesh.degenerate_count();
  health.concave = data.concave;
  health.coordinate_resolution = CoordinateResolution(mesh.bounds(), data.single_precision);
  const std::vector<std::uint32_t> joined =
      JoinPositions(std::span<const Vec3d>(data.vertices), mesh.triangles(), &poll);
  CountEdges(mesh, joined, &poll, &health);
  health.duplicate = CountDuplicates(mesh, joined, &poll);
  if (poll.stopped()) return poll.ToError();
  return health;
}

}  // namespace kdray::core
