// SPDX-License-Identifier: Apache-2.0
// Cuts at evenly spaced planes: what a large node can afford.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "core/accel/kdtree/split.h"
#include "core/accel/primitive_ref.h"
#include "core/base/float4.h"
#include "core/geometry/bounds3.h"

namespace kdray::core {

/// The planes that a node may be cut at, one axis a lane: plane k of an axis lies at (first + k) /
/// scale. A scale is a power of two, so products with it are exact, and floor and ceiling tell
/// exactly which planes lie below a coordinate and which above.
class PlaneGrid {
 public:
  static constexpr int kBins = 32;

  /// From 16 to 32 bins of each axis; fewer where the bounds are a few floats wide, none where they
  /// are flat.
  explicit PlaneGrid(const Bounds3f& bounds);

  /// For coordinates within the bounds: the last plane that does not lie above, from 0 to kBins.
  Int4 Floor(Float4 coordinates) const {
    const Float4 scaled = coordinates * scale_;
    const Int4 truncated = Truncate4(scaled);
    return truncated - first_ + (ToFloat4(truncated) > scaled);  // a comparison gives -1 for true
  }
  /// The last plane that lies below, from -1 on.
  Int4 CeilingLessOne(Float4 coordinates) const {
    const Float4 scaled = coordinates * scale_;
    const Int4 truncated = Truncate4(scaled);
    return truncated - first_ - 1 - (ToFloat4(truncated) < scaled);
  }
  Float4 Position(int k) const { return ToFloat4(first_ + k) * spacing_; }
  /// Planes 0 to planes() - 1 lie at the bounds or in them on some axis, and no others.
  int planes() const { return planes_; }

 private:
  Float4 scale_ = Fill4(0);
  Float4 spacing_ = Fill4(0);
  Int4 first_ = {};
  int planes_ = 0;
};

/// How many of a node's references begin and end between the planes of its grid. Made once, also
/// when empty space is cut off the node's cell. Source: Shevtsov, Soupikov, Kapustin, "Highly
/// Parallel Fast KD-tree Construction for Interactive Ray Tracing of Dynamic Scenes", 2007 (min-max
/// binning).
class BinnedCounts {
 public:
  /// `bounds` is the union of the references'. Large spans are counted in parallel, with the same
  /// result. O(n) time.
  BinnedCounts(std::span<const PrimitiveRef> references, const Bounds3f& bounds,
               BuildMonitor* monitor = nullptr);

  /// The cheapest of the cuts at the grid's planes and at the faces of the references' bounds,
  /// which cut off exactly the empty space; nothing when a leaf is cheaper. `cell` contains the
  /// bounds.
  std::optional<SplitCandidate> FindSplit(const Bounds3f& cell, const SahCost& cost) const;

 private:
  // [At(k, axis)]: a number for plane k, -1 included. Four places a plane, one an axis.
  using Bins = std::array<std::uint32_t, 4 * (PlaneGrid::kBins + 2)>;
  static std::size_t At(int k, std::size_t axis) {
    return 4 * static_cast<std::size_t>(k + 1) + axis;
  }
  struct Counts {
    std::size_t places = 0;  // that are in use in each of the three; the others have no value
    Bins begin;              // n that begin at plane k or beyond, and before plane k + 1
    Bins end;                // n that end beyond plane k, and at plane k + 1 or before
    Bins planar;             // n that lie in plane k; no values unless any_planar
    bool any_planar = false;

    Counts() = default;
    explicit Counts(const PlaneGrid& grid);
    void AddPlanar(std::size_t place, std::uint32_t number);
    void Add(const Counts& other);
  };
  // The cheapest plane of each axis, as far as floats can tell.
  struct BestPlanes {
    std::array<int, 3> plane;  // -1: there is none
    std::array<std::uint32_t, 3> below, above;
  };

  static Counts Count(std::span<const PrimitiveRef> references, const PlaneGrid& grid);
  BestPlanes FindBestPlanes(const std::array<SplitSearch::Axis, 3>& axes,
                            const Bounds3f& cell) const;

  PlaneGrid grid_;
  Bounds3f bounds_;
  std::size_t triangles_;
  Counts counts_;
};

}  // namespace kdray::core
