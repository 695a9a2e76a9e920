// SPDX-License-Identifier: Apache-2.0
// The search for a point's closest triangle: what decides between triangles, and the plain walk of
// the tree, in double. The kernels (core/proximity/simd) walk it with vectors and cull more
// cheaply; the decision is the same.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "core/accel/wide/wide_tree.h"
#include "core/base/cancel_poll.h"
#include "core/geometry/hit.h"
#include "core/geometry/triangle_mesh.h"
#include "core/proximity/exact_distance.h"
#include "core/proximity/point_triangle.h"

namespace kdray::core {

/// Work (CancelPoll) of a search: preparing a point, a step to a node's children, a block of
/// triangles, a distance in double, and a comparison that integers may decide.
inline constexpr std::uint64_t kPointWork = 128;
inline constexpr std::uint64_t kPointNodeWork = 64;
inline constexpr std::uint64_t kPointBlockWork = 64;
inline constexpr std::uint64_t kDistanceWork = 128;
inline constexpr std::uint64_t kCompareWork = 8192;

/// A point in the frame, as the searches see it.
struct SearchPoint {
  Vec3d at;         ///< local
  double size = 0;  ///< largest |component|
  /// How much closer a triangle may be to the point as given than to `at`, compared with another.
  double doubt = 0;
};

/// `world` in the frame. A point farther than 2^24 mesh sizes is moved to that distance along its
/// way to the nearest point c of `bounds` (local). The distances from both points to a point q of
/// the mesh, less those to c, differ by at most |q - c|^2 / 2^25 <= 12 * 2^-25.
SearchPoint MakeSearchPoint(const Vec3d& world, const MeshFrame& frame, const Bounds3d& bounds);

/// Keeps the closest of the triangles that it is offered: of equal distances the smallest id.
/// Decides in double, so an answer's distance is within kDistanceError of the closest one's.
template <class Stored>
class DoubleJudge {
 public:
  DoubleJudge(std::span<const Vec3<Stored>> vertices, std::span<const TriangleIndices> triangles)
      : vertices_(vertices), triangles_(triangles) {}

  /// Starts a point.
  [[gnu::always_inline]] void Begin(const SearchPoint& point) {
    at_ = point.at;
    slack_ = 2 * kDistanceError * (point.size + 2);
    square_ = std::numeric_limits<double>::infinity();
    id_ = kNoPrimitive;
  }
  [[gnu::always_inline]] bool Offer(PrimitiveId id, CancelPoll* poll) {
    if (id == id_) return false;  // seen already in another leaf
    poll->Spend(kDistanceWork);
    const TriangleIndices& t = triangles_[id];
    const double square = SquaredDistance(at_, Vec3d(vertices_[t[0]]), Vec3d(vertices_[t[1]]),
                                          Vec3d(vertices_[t[2]]));
    if (!(square < square_ || (square == square_ && id < id_))) return false;
    square_ = square;
    id_ = id;
    return true;
  }
  /// The distance beyond which no triangle wins.
  [[gnu::always_inline]] double Limit() const {
    return std::sqrt(square_) * (1 + 0x1p-50) + slack_;
  }
  PrimitiveId id() const { return id_; }

 private:
  std::span<const Vec3<Stored>> vertices_;
  std::span<const TriangleIndices> triangles_;
  Vec3d at_;
  double slack_ = 0;
  double square_ = 0;
  PrimitiveId id_ = kNoPrimitive;
};

/// The same for the real distances of the points as given: in double if the error bound allows,
/// else by ExactPoint.
class ExactJudge {
 public:
  explicit ExactJudge(const TriangleMesh& mesh) : mesh_(&mesh) {}

  /// `world` is the point as given. Triangles farther than `within` (local) are not of interest.
  void Begin(const SearchPoint& point, const Vec3d& world,
             double within = std::numeric_limits<double>::infinity());
  bool Offer(PrimitiveId id, CancelPoll* poll);
  double Limit() const { return limit_; }
  PrimitiveId id() const { return id_; }
  /// Whether the point lies on the kept triangle.
  bool IsOnSurface() const { return id_ != kNoPrimitive && exact_->IsOn(CornersOf(id_)); }
  /// Of the kept triangle.
  ExactFoot Finish() const { return exact_->FootOn(CornersOf(id_)); }

 private:
  TriangleCorners CornersOf(PrimitiveId id) const {
    return {mesh_->LocalCorner(id, 0), mesh_->LocalCorner(id, 1), mesh_->LocalCorner(id, 2)};
  }

  const TriangleMesh* mesh_;
  std::optional<ExactPoint> exact_;
  Vec3d at_;
  double error_ = 0;     // of a distance in double
  double distance_ = 0;  // of the kept triangle
  double limit_ = 0;
  PrimitiveId id_ = kNoPrimitive;
};

/// Offers the judge every triangle that may win. Some are missing once the poll has stopped.
template <class Judge>
void SearchPlainly(const WideTree& tree, const SearchPoint& point, Judge* judge, CancelPoll* poll) {
  if (tree.root == WideChild::kEmpty) return;
  struct Entry {
    double distance;
    std::uint32_t child;
  };
  // Distances to boxes are rounded a few times; those of far points keep less than the pad's part.
  const auto distance_to = [&](const WideNode& node, std::size_t c) {
    double square = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double x = point.at[axis];
      const double d = std::max({static_cast<double>(node.low[axis][c]) - x,
                                 x - static_cast<double>(node.high[axis][c]), 0.0});
      square += d * d;
    }
    return std::sqrt(square) * (1 - 0x1p-48);
  };
  std::vector<Entry> stack = {{0, tree.root}};
  while (!stack.empty()) {
    const Entry entry = stack.back();
    stack.pop_back();
    if (entry.distance > judge->Limit()) continue;
    if ((entry.child & WideChild::kLeafBit) == 0) {
      if (poll->Spend(kPointNodeWork)) return;
      const WideNode& node = tree.nodes[entry.child];
      const std::size_t begin = stack.size();
      for (std::size_t c = 0; c < WideNode::kWidth; ++c) {
        if (node.child[c] == WideChild::kEmpty) continue;
        const double distance = distance_to(node, c);
        if (distance <= judge->Limit()) stack.push_back({distance, node.child[c]});
      }
      std::sort(stack.begin() + static_cast<std::ptrdiff_t>(begin), stack.end(),
                [](const Entry& a, const Entry& b) { return a.distance > b.distance; });
      continue;
    }
    for (std::size_t b = entry.child & ~WideChild::kLeafBit;; ++b) {
      if (poll->Spend(kPointBlockWork)) return;
      const LeafBlock& block = tree.blocks[b];
      for (std::size_t lane = 0; lane < LeafBlock::kWidth; ++lane) {
        if (block.IdOf(lane) != LeafBlock::kIdMask) judge->Offer(block.IdOf(lane), poll);
      }
      if (block.IsLast()) break;
    }
  }
}

}  // namespace kdray::core
