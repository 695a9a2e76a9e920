// SPDX-License-Identifier: Apache-2.0
// Candidate splits of a kd-tree node, and the choice among them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "core/accel/sah_cost.h"
#include "core/geometry/bounds3.h"

namespace kdray::core {

/// The split plane: the below child has coordinates <= `position`, the above child >= `position`.
struct SplitPlane {
  int axis = 0;
  float position = 0;
  friend bool operator==(const SplitPlane&, const SplitPlane&) = default;

  /// Strictly inside, so both children have smaller cells than their parent.
  bool IsInside(const Bounds3f& cell) const {
    return cell.min[axis] < position && position < cell.max[axis];
  }
  Bounds3f BelowCell(Bounds3f cell) const {
    cell.max[axis] = position;
    return cell;
  }
  Bounds3f AboveCell(Bounds3f cell) const {
    cell.min[axis] = position;
    return cell;
  }
};

/// A split with its cost. Triangles in the plane go to one side only; a ray that touches the plane
/// visits both sides.
struct SplitCandidate {
  SplitPlane plane;
  bool planar_below = true;
  std::size_t below = 0;  ///< triangles whose bounds reach into the below child
  std::size_t above = 0;  ///< likewise; those that cross the plane count on both sides
  double cost = 0;
};

/// The probabilities that a random line through `cell` meets the two parts at a plane: the ratios
/// of surface areas. Made once per cell and axis, because most of the computation does not depend
/// on the plane.
class SplitProbability {
 public:
  SplitProbability(const Bounds3f& cell, int axis);

  /// `position` lies within the cell.
  double Below(float position) const {
    return base_ + slope_ * (static_cast<double>(position) - low_);
  }
  double Above(float position) const {
    return base_ + slope_ * (high_ - static_cast<double>(position));
  }

  /// Below(x) = base() + slope() * (x - low end of the cell).
  double base() const { return base_; }
  double slope() const { return slope_; }

  /// False for a cell without surface area, where a split gains nothing.
  bool IsValid() const { return valid_; }

 private:
  double low_, high_;
  double base_ = 0;   // the two faces in the plane, over the cell's area
  double slope_ = 0;  // the girth, over the cell's area
  bool valid_ = false;
};

/// Keeps the cheapest of the considered splits, and the first of equally cheap ones. So the choice
/// depends only on their order.
class SplitSearch {
 public:
  /// Considers only splits that are cheaper than a leaf with `triangles` triangles.
  SplitSearch(const SahCost& cost, const Bounds3f& cell, std::size_t triangles)
      : cost_(cost), cell_(cell), triangles_(triangles), best_cost_(cost.Subtree(triangles)) {}

  /// The splits across one axis.
  class Axis {
   public:
    Axis(SplitSearch* search, int axis)
        : search_(search), axis_(axis), probability_(search->cell_, axis) {
      if (!probability_.IsValid()) return;
      low_ = search->cell_.min[axis];
      high_ = search->cell_.max[axis];
    }

    const SplitProbability& probability() const { return probability_; }
    /// The cell's ends, if the probability is valid.
    float low() const { return low_; }
    float high() const { return high_; }

    /// Considers a plane with these numbers of triangles that reach below it, lie in it, and reach
    /// above it; triangles that cross it count twice. Skips planes that are not strictly inside the
    /// cell.
    void Consider(float position, std::size_t below, std::size_t planar, std::size_t above) {
      if (!IsUsable(position)) return;
      Offer(position, below + planar, above, true);
      if (planar != 0) Offer(position, below, above + planar, false);
    }

    /// Positions between the two ends are inside the cell; none is if the cell has no surface area.
    bool IsAboveCellsLowEnd(float position) const { return position > low_; }
    bool IsBelowCellsHighEnd(float position) const { return position < high_; }

    /// Considers the planes where the triangles begin and end: they cut off empty space, with all
    /// triangles on the other side.
    void ConsiderEmptyBelow(float position) {
      if (IsUsable(position)) Offer(position, 0, search_->triangles_, false);
    }
    void ConsiderEmptyAbove(float position) {
      if (IsUsable(position)) Offer(position, search_->triangles_, 0, true);
    }

   private:
    bool IsUsable(float position) const {
      return IsAboveCellsLowEnd(position) && IsBelowCellsHighEnd(position);
    }
    void Offer(float position, std::size_t below, std::size_t above, bool planar_below) {
      const double cost = search_->cost_.Split(probability_.Below(position), below,
                                               probability_.Above(position), above);
      if (cost < search_->best_cost_) {
        search_->best_cost_ = cost;
        search_->best_ = SplitCandidate{{axis_, position}, planar_below, below, above, cost};
      }
    }

    SplitSearch* search_;
    int axis_;
    SplitProbability probability_;
    float low_ = 0, high_ = 0;  // of the cell
  };

  const std::optional<SplitCandidate>& best() const { return best_; }

 private:
  const SahCost& cost_;
  const Bounds3f& cell_;
  std::size_t triangles_;
  double best_cost_;
  std::optional<SplitCandidate> best_;
};

}  // namespace kdray::core
