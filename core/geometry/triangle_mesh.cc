// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/triangle_mesh.h"

#include <algorithm>
#include <cassert>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "core/base/cancel_poll.h"
#include "core/geometry/predicates.h"

namespace kdray::core {
namespace {

// Work (CancelPoll) of a loop's step over vertices or triangles, over flags, and of the exact
// predicate on a triangle. Every loop here ends early when the poll has stopped; Create() checks
// the poll at the end.
constexpr std::uint64_t kStepWork = 16;
constexpr std::uint64_t kFlagWork = 2;
constexpr std::uint64_t kPredicateWork = 256;

// The vertices that triangles use. Only these matter: a file may store others, even invalid ones.
std::vector<bool> FindUsed(std::size_t vertices, std::span<const TriangleIndices> triangles,
                           CancelPoll* poll) {
  std::vector<bool> used(vertices);
  PolledLoop(triangles.size(), kStepWork, poll, [&](std::size_t i) {
    for (const std::uint32_t index : triangles[i]) {
      assert(index < used.size());
      used[index] = true;
    }
  });
  return used;
}

template <class F>
void ForEachUsed(const MeshData& data, const std::vector<bool>& used, CancelPoll* poll, F&& f) {
  PolledLoop(data.vertices.size(), kStepWork, poll, [&](std::size_t i) {
    if (used[i]) f(data.vertices[i]);
  });
}

std::string Shortest(double value) {
  char text[32];
  return std::string(text, std::to_chars(text, text + sizeof text, value).ptr);
}

std::optional<Error> CheckCoordinates(const MeshData& data, const std::vector<bool>& used,
                                      CancelPoll* poll) {
  for (std::size_t i = 0; i < data.vertices.size(); ++i) {
    if (poll->Spend(1)) return poll->ToError();
    if (!used[i]) continue;
    for (int axis = 0; axis < 3; ++axis) {
      const double value = data.vertices[i][axis];
      if (std::fabs(value) <= kMaxCoordinate) continue;  // false for NaN
      const char* why = std::isfinite(value) ? " is beyond 3.4e38" : " is not finite";
      return Error{ErrorCode::kInvalidMesh, "vertex " + std::to_string(i + 1) +
                                                " (counted from 1): " + "xyz"[axis] + " = " +
                                                Shortest(value) + why};
    }
  }
  return std::nullopt;
}

// `center` rounded to a multiple of the smallest power of two >= `extent`.
double RoundToExtent(double center, double extent) {
  if (extent == 0) return center;
  int exponent = 0;
  if (std::frexp(extent, &exponent) == 0.5) --exponent;   // a power of two is its own
  if (std::ilogb(center) - exponent > 52) return center;  // a multiple already
  return std::ldexp(std::nearbyint(std::ldexp(center, -exponent)), exponent);
}

// Far from 0 means more than four times the size of the mesh; nearer, a subtraction would gain at
// most three bits. So every coordinate is within a factor of 2 of the origin, which differs from
// the centre by at most one extent, and their difference is a double (Sterbenz's lemma).
Vec3d ChooseOrigin(const Bounds3d& bounds) {
  const Vec3d center = bounds.Center();
  const double extent = MaxAbs(bounds.Extent());
  Vec3d origin;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::fabs(center[axis]) > 4 * extent) origin[axis] = RoundToExtent(center[axis], extent);
  }
  return origin;
}

MeshFrame ChooseFrame(const Bounds3d& bounds) {
  MeshFrame frame;
  frame.origin = ChooseOrigin(bounds);
  const double largest =
      std::max(MaxAbs(bounds.min - frame.origin), MaxAbs(bounds.max - frame.origin));
  if (largest > 0) std::frexp(largest, &frame.exponent);
  return frame;
}

/// Whether the frame represents a vertex exactly. Only scaling down can round, and only below
/// 2^-1022.
bool IsExactIn(const MeshFrame& frame, const Vec3d& p) {
  if (frame.exponent <= 0) return true;
  const Vec3d local = frame.ToLocal(p);
  for (int axis = 0; axis < 3; ++axis) {
    if (ScaleByPowerOfTwo(local[axis], frame.exponent) != p[axis] - frame.origin[axis])
      return false;
  }
  return true;
}

bool IsFloat(const Vec3d& p) { return Vec3d(Vec3f(p)) == p; }

template <class T>
std::vector<Vec3<T>> LocalVertices(const MeshData& data, const std::vector<bool>& used,
                                   const MeshFrame& frame, CancelPoll* poll) {
  std::vector<Vec3<T>> local;
  local.reserve(data.vertices.size());
  PolledLoop(data.vertices.size(), kStepWork, poll, [&](std::size_t i) {
    local.push_back(used[i] ? Vec3<T>(frame.ToLocal(data.vertices[i])) : Vec3<T>());
  });
  return local;
}

std::vector<TriangleIndices> Copy(std::span<const TriangleIndices> triangles, CancelPoll* poll) {
  std::vector<TriangleIndices> copy;
  copy.reserve(triangles.size());
  PolledLoop(triangles.size(), kStepWork, poll,
             [&](std::size_t i) { copy.push_back(triangles[i]); });
  return copy;
}

template <class T>
std::vector<bool> FindDegenerate(std::span<const Vec3<T>> vertices,
                                 std::span<const TriangleIndices> triangles, CancelPoll* poll) {
  std::vector<bool> degenerate(triangles.size());
  PolledLoop(triangles.size(), kPredicateWork, poll, [&](std::size_t i) {
    const auto [a, b, c] = triangles[i];
    degenerate[i] = AreCollinear(Vec3d(vertices[a]), Vec3d(vertices[b]), Vec3d(vertices[c]));
  });
  return degenerate;
}

template <class T>
double FindShortestEdge(std::span<const Vec3<T>> vertices,
                        std::span<const TriangleIndices> triangles,
                        const std::vector<bool>& degenerate, CancelPoll* poll) {
  double shortest = std::numeric_limits<double>::infinity();
  PolledLoop(triangles.size(), kStepWork, poll, [&](std::size_t i) {
    if (degenerate[i]) return;  // the only triangles with edges of no length
    const auto [a, b, c] = triangles[i];
    for (const auto& [from, to] : {std::pair{a, b}, {b, c}, {c, a}}) {
      shortest = std::min(shortest, MaxAbs(Vec3d(vertices[to]) - Vec3d(vertices[from])));
    }
  });
  return shortest;
}

std::size_t CountTrue(const std::vector<bool>& flags, CancelPoll* poll) {
  std::size_t count = 0;
  PolledLoop(flags.size(), kFlagWork, poll, [&](std::size_t i) { count += flags[i] ? 1 : 0; });
  return count;
}

}  // namespace

Result<TriangleMesh> TriangleMesh::Create(const MeshData& data, const CancelToken& cancel) {
  CancelPoll poll(cancel);
  std::vector<TriangleIndices> triangles = Copy(data.triangles, &poll);
  if (poll.stopped()) return poll.ToError();
  return Create(data, std::move(triangles), cancel);
}

Result<TriangleMesh> TriangleMesh::Create(MeshData* data, const CancelToken& cancel) {
  std::vector<TriangleIndices> triangles = std::move(data->triangles);
  return Create(*data, std::move(triangles), cancel);
}

// `triangles`: those of `data`, whose own may be gone.
Result<TriangleMesh> TriangleMesh::Create(const MeshData& data,
                                          std::vector<TriangleIndices> triangles,
                                          const CancelToken& cancel) {
  if (triangles.empty()) return Error{ErrorCode::kEmptyMesh, "the mesh has no triangle"};
  if (triangles.size() > kMaxTriangles) {
    return Error{ErrorCode::kMeshTooLarge, "the mesh has " + std::to_string(triangles.size()) +
                                               " triangles; at most " +
                                               std::to_string(kMaxTriangles) + " are allowed"};
  }
  if (data.vertices.size() > kMaxVertices) {
    return Error{ErrorCode::kMeshTooLarge, "the mesh has " + std::to_string(data.vertices.size()) +
                                               " vertices; at most " +
                                               std::to_string(kMaxVertices) + " are allowed"};
  }
  CancelPoll poll(cancel);
  const std::vector<bool> used = FindUsed(data.vertices.size(), triangles, &poll);
  if (std::optional<Error> error = CheckCoordinates(data, used, &poll)) return *std::move(error);

  TriangleMesh mesh;
  mesh.format_ = data.format;
  mesh.vertex_count_ = data.vertices.size();
  mesh.bounds_ = Bounds3d::Empty();
  ForEachUsed(data, used, &poll, [&](const Vec3d& p) { mesh.bounds_.Extend(p); });
  if (poll.stopped()) return poll.ToError();
  mesh.frame_ = ChooseFrame(mesh.bounds_);

  bool all_floats = true;
  ForEachUsed(data, used, &poll, [&](const Vec3d& p) {
    all_floats = all_floats && IsFloat(mesh.frame_.ToLocal(p));
    mesh.has_rounded_vertices_ = mesh.has_rounded_vertices_ || !IsExactIn(mesh.frame_, p);
  });
  if (all_floats) {
    mesh.vertices_ = LocalVertices<float>(data, used, mesh.frame_, &poll);
  } else {
    mesh.vertices_ = LocalVertices<double>(data, used, mesh.frame_, &poll);
  }
  mesh.triangles_ = std::move(triangles);
  if (poll.stopped()) return poll.ToError();  // before an index can exceed the vertices
  mesh.degenerate_ = mesh.VisitVertices(
      [&](auto vertices) { return FindDegenerate(vertices, mesh.triangles(), &poll); });
  mesh.degenerate_count_ = CountTrue(mesh.degenerate_, &poll);
  mesh.shortest_edge_ = mesh.VisitVertices([&](auto vertices) {
    return FindShortestEdge(vertices, mesh.triangles(), mesh.degenerate_, &poll);
  });
  if (poll.stopped()) return poll.ToError();
  return mesh;
}

Result<TriangleMesh> TriangleMesh::FromParts(Parts parts, const CancelToken& cancel) {
  assert(parts.degenerate.size() == parts.triangles.size());
  TriangleMesh mesh;
  mesh.format_ = parts.format;
  mesh.frame_ = parts.frame;
  mesh.bounds_ = parts.bounds;
  mesh.vertices_ = std::move(parts.vertices);
  mesh.vertex_count_ = mesh.VisitVertices([](auto vertices) { return vertices.size(); });
  mesh.triangles_ = std::move(parts.triangles);
  mesh.degenerate_ = std::move(parts.degenerate);
  CancelPoll poll(cancel);
  mesh.degenerate_count_ = CountTrue(mesh.degenerate_, &poll);
  mesh.shortest_edge_ = mesh.VisitVertices([&](auto vertices) {
    return FindShortestEdge(vertices, mesh.triangles(), mesh.degenerate_, &poll);
  });
  if (poll.stopped()) return poll.ToError();
  return mesh;
}

std::size_t TriangleMesh::bytes() const {
  return VisitVertices([](auto vertices) { return vertices.size_bytes(); }) +
         triangles_.size() * sizeof(TriangleIndices) + (degenerate_.size() + 7) / 8;
}

}  // namespace kdray::core
