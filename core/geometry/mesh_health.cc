#include "core/geometry/mesh_health.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <span>
#include <tuple>
#include <vector>

namespace kdray::core {
namespace {

// Values by key: those of key k are values[start[k]] up to values[start[k + 1]].
struct Groups {
  std::vector<std::uint32_t> start;
  std::vector<std::uint64_t> values;

  std::size_t size() const { return start.size() - 1; }
  std::span<std::uint64_t> operator[](std::size_t key) {
    return std::span(values).subspan(start[key], start[key + 1] - start[key]);
  }
};

// for_each(emit) must call emit(key, value) the same way each time; key < keys.
template <class ForEach>
Groups GroupByKey(std::size_t keys, const ForEach& for_each) {
  Groups groups;
  groups.start.assign(keys + 1, 0);
  for_each([&](std::size_t key, std::uint64_t) { ++groups.start[key]; });
  std::partial_sum(groups.start.begin(), groups.start.end(), groups.start.begin());
  groups.values.resize(groups.start.back());
  for_each([&](std::size_t key, std::uint64_t value) {
    groups.values[--groups.start[key]] = value;  // from the end of the group down to its start
  });
  return groups;
}

// Equal values get neighbours; visit(first, last) is called for each run of values that `same`
// holds for.
template <class Same, class Visit>
void ForEachRun(std::span<const std::uint64_t> values, const Same& same, const Visit& visit) {
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
std::vector<std::uint32_t> JoinPositions(const MeshData& data) {
  const std::vector<Vec3d>& vertices = data.vertices;
  std::vector<bool> used(vertices.size());
  for (const TriangleIndices& triangle : data.triangles) {
    for (const std::uint32_t index : triangle) used[index] = true;
  }
  const std::size_t keys = std::bit_ceil(vertices.size() / 4 + 1);
  Groups groups = GroupByKey(keys, [&](const auto& emit) {
    for (std::size_t i = 0; i < vertices.size(); ++i) {
      if (used[i]) emit(HashPosition(vertices[i]) & (keys - 1), i);
    }
  });
  std::vector<std::uint32_t> joined(vertices.size());
  for (std::size_t key = 0; key < groups.size(); ++key) {
    const std::span<std::uint64_t> group = groups[key];
    std::sort(group.begin(), group.end(), [&](std::uint64_t a, std::uint64_t b) {
      const Vec3d& p = vertices[a];
      const Vec3d& q = vertices[b];
      return std::tie(p.x, p.y, p.z, a) < std::tie(q.x, q.y, q.z, b);
    });
    ForEachRun(
        group, [&](std::uint64_t a, std::uint64_t b) { return vertices[a] == vertices[b]; },
        [&](std::span<const std::uint64_t> run) {
          for (const std::uint64_t index : run) joined[index] = static_cast<std::uint32_t>(run[0]);
        });
  }
  return joined;
}

void CountEdges(const TriangleMesh& mesh, const MeshData& data,
                const std::vector<std::uint32_t>& joined, MeshHealth* health) {
  // Each side of a triangle, by the smaller of its vertices: the larger, and whether it runs from
  // the smaller to the larger.
  Groups groups = GroupByKey(joined.size(), [&](const auto& emit) {
    for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
      if (mesh.IsDegenerate(id)) continue;
      const TriangleIndices& triangle = data.triangles[id];
      for (std::size_t corner = 0; corner < 3; ++corner) {
        const std::uint64_t from = joined[triangle[corner]];
        const std::uint64_t to = joined[triangle[(corner + 1) % 3]];
        emit(std::min(from, to), 2 * std::max(from, to) + (from < to ? 1 : 0));
      }
    }
  });
  bool all_paired = !groups.values.empty();
  for (std::size_t key = 0; key < groups.size(); ++key) {
    const std::span<std::uint64_t> group = groups[key];
    std::sort(group.begin(), group.end());
    ForEachRun(
        group, [](std::uint64_t a, std::uint64_t b) { return a / 2 == b / 2; },
        [&](std::span<const std::uint64_t> edge) {
          if (edge.size() == 1) ++health->open_edges;
          if (edge.size() > 2) ++health->non_manifold_edges;
          all_paired = all_paired && edge.size() == 2 && edge[0] != edge[1];
        });
  }
  health->closed = all_paired;
}

std::uint64_t CountDuplicates(const TriangleMesh& mesh, const MeshData& data,
                              const std::vector<std::uint32_t>& joined) {
  Groups groups = GroupByKey(joined.size(), [&](const auto& emit) {
    for (PrimitiveId id = 0; id < data.triangles.size(); ++id) {
      if (mesh.IsDegenerate(id)) continue;
      const TriangleIndices& triangle = data.triangles[id];
      std::array<std::uint64_t, 3> corners = {joined[triangle[0]], joined[triangle[1]],
                                              joined[triangle[2]]};
      std::sort(corners.begin(), corners.end());
      emit(corners[0], corners[1] << 32 | corners[2]);
    }
  });
  std::uint64_t duplicates = 0;
  for (std::size_t key = 0; key < groups.size(); ++key) {
    const std::span<std::uint64_t> group = groups[key];
    std::sort(group.begin(), group.end());
    ForEachRun(group, std::equal_to<>(),
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

MeshHealth CheckHealth(const TriangleMesh& mesh, const MeshData& data) {
  MeshHealth health;
  health.degenerate = mesh.degenerate_count();
  health.concave = data.concave;
  health.coordinate_resolution = CoordinateResolution(mesh.bounds(), data.single_precision);
  const std::vector<std::uint32_t> joined = JoinPositions(data);
  CountEdges(mesh, data, joined, &health);
  health.duplicate = CountDuplicates(mesh, data, joined);
  return health;
}

}  // namespace kdray::core
