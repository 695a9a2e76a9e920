// SPDX-License-Identifier: Apache-2.0
// Triangulates polygons: a polygon of n corners always becomes n - 2 triangles that use its corners
// and keep its winding.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/result.h"
#include "core/geometry/cut_meter.h"
#include "core/geometry/ear_cutter.h"
#include "core/geometry/predicates.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// Corners of a concave polygon, at most: triangulating one takes
/// PolygonCutter::kScratchBytesPerCorner bytes for each.
inline constexpr std::size_t kMaxConcaveCorners = 262144;

/// True when the closed path through the points goes once, counterclockwise, around a convex
/// region. Points on a straight edge and repeated points are allowed; a path without area counts as
/// convex. Exact (Orient2d). O(n).
bool IsConvexPath(std::span<const Point2> path);

/// Appends to a mesh the triangles of its polygons. Not safe from two threads at once.
class PolygonCutter {
 public:
  /// Memory for each corner of the largest concave polygon; the destructor frees it.
  static constexpr std::size_t kScratchBytesPerCorner = EarCutter::kScratchBytesPerCorner + 16;
  /// A file may cost kStepsPerFile steps (about nanoseconds), and kStepsPerCorner more for each
  /// corner of a polygon. A corner usually takes 1,000 to 3,000.
  static constexpr std::uint64_t kStepsPerFile = 8'000'000'000;
  static constexpr std::uint64_t kStepsPerCorner = 4'000;

  /// Reads mesh->vertices; appends to mesh->triangles and counts in mesh->dropped, mesh->concave.
  /// The mesh must outlive the cutter. One cutter serves one file. `cuts`, if given, gets each
  /// triangle of mesh->triangles as positions in its polygon, counted from 0.
  PolygonCutter(MeshData* mesh, CancelToken cancel, std::uint64_t steps_per_file = kStepsPerFile,
                std::vector<TriangleIndices>* cuts = nullptr);

  /// Adds one polygon by its corners, each < mesh->vertices.size(). A polygon with fewer than three
  /// corners is dropped and counted. It is projected along the main axis of its normal (Newell's,
  /// so a warped polygon has one too). A convex polygon is fanned from its first corner; so is one
  /// whose corners lie on one line or are not finite. Any other is triangulated by ear clipping and
  /// counted as concave.
  ///
  /// In the projection, which rounds nothing, the triangles cover the polygon exactly and do not
  /// overlap, also if the polygon touches itself: corners on edges or on corners, loops that meet
  /// in a point, holes connected by a doubled edge, edges that overlap, lines that go out and back.
  /// If it crosses itself, there are still n - 2 triangles. A crossing at corners separates loops,
  /// each of which is covered by itself where possible. A crossing as small as rounding costs an
  /// area as small.
  ///
  /// Errors: kInvalidMesh (kMaxConcaveCorners; more steps than this file may cost), kCancelled,
  /// kDeadlineExceeded. O(n) for a convex polygon, O(n log n) for others as in real files.
  Status Add(std::span<const std::uint32_t> corners) {
    if (corners.size() == 3) {
      mesh_->triangles.push_back({corners[0], corners[1], corners[2]});
      if (cuts_ != nullptr) cuts_->push_back({0, 1, 2});
      return {};
    }
    return AddOther(corners);
  }

 private:
  // The projection of a polygon.
  struct View {
    int axis = 0;             // the coordinate that is dropped
    bool mirrored = false;    // whether the two others are exchanged
    bool is_certain = false;  // whether the projected polygon is known to be counterclockwise
  };

  Status AddOther(std::span<const std::uint32_t> corners);
  View ViewOf(std::span<const std::uint32_t> corners);
  Point2 Seen(std::uint32_t corner, const View& view) const;
  void MirrorPath();
  void Fan(std::span<const std::uint32_t> corners);
  void CutConcave(std::span<const std::uint32_t> corners, const View& view);
  Status WhyStopped(std::size_t corners) const;

  MeshData* mesh_;
  CutMeter meter_;
  EarCutter ears_;
  std::vector<Point2> path_;
  std::vector<TriangleIndices>* cuts_;
};

}  // namespace kdray::core
