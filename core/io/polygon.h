// Polygons to triangles: a polygon of n corners always becomes n - 2 triangles that use its corners
// and keep its winding.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/predicates.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// A concave polygon with more corners is refused (kMeshTooLarge): cutting one takes O(n^2) time,
/// some seconds at this size.
inline constexpr std::size_t kMaxConcaveCorners = 65536;

/// True when the closed path through the points goes once, counterclockwise, around a convex
/// region. Points on a straight edge and repeated points are allowed; a path without area counts as
/// convex. Exact (Orient2d). O(n).
bool IsConvexPath(std::span<const Point2> path);

/// Appends to a mesh the triangles of its polygons. Not safe from two threads at once.
class PolygonCutter {
 public:
  /// Reads mesh->vertices; appends to mesh->triangles and counts in mesh->dropped, mesh->concave.
  /// The mesh must outlive the cutter.
  PolygonCutter(MeshData* mesh, CancelToken cancel) : mesh_(mesh), cancel_(std::move(cancel)) {}

  /// One polygon by its corners, each < mesh->vertices.size(). Fewer than three: dropped and
  /// counted. A convex one is fanned from its first corner. One that is not, seen along the main
  /// axis of its normal (Newell's, so a warped polygon has one too), is cut by ears and counted as
  /// concave; where it has no ear because it crosses itself, a corner is cut all the same. A
  /// polygon whose normal is zero or not finite is fanned. Errors: kMeshTooLarge
  /// (kMaxConcaveCorners), kCancelled, kDeadlineExceeded. O(n) for a convex polygon, O(n^2) for
  /// another.
  Status Add(std::span<const std::uint32_t> corners) {
    if (corners.size() == 3) {
      mesh_->triangles.push_back({corners[0], corners[1], corners[2]});
      return {};
    }
    return AddOther(corners);
  }

 private:
  // A corner of the polygon that is being cut, in the list of those that are left.
  struct Corner {
    Point2 point;
    std::uint32_t previous = 0;
    std::uint32_t next = 0;
    std::uint32_t scanned = 0;  // blockers_[0, scanned) are known not to block this ear
    std::int8_t turn = 0;       // Orient2d(previous, this, next)
    bool left = true;           // not cut yet
  };

  Status AddOther(std::span<const std::uint32_t> corners);
  void Fan(std::span<const std::uint32_t> corners);
  Status CutEars(std::span<const std::uint32_t> corners);
  void Update(std::uint32_t corner);
  bool IsEar(std::uint32_t corner);
  bool Blocks(const Corner& other, const Corner& a, const Corner& b, const Corner& c) const;
  std::uint32_t LeastHarmful(std::uint32_t start) const;

  MeshData* mesh_;
  CancelToken cancel_;
  std::vector<Corner> corners_;
  std::vector<std::uint32_t> blockers_;
};

}  // namespace kdray::core
