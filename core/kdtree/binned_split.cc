#include "core/kdtree/binned_split.h"

#include <array>
#include <cstdint>

namespace kdray::core {

namespace {

constexpr std::size_t kBins = 32;
constexpr std::size_t kFaces = kBins + 1;

// The planes of one axis, ascending, and for a coordinate how many of them lie at or below it.
class Faces {
 public:
  Faces(float low, float high)
      : low_(static_cast<double>(low)), width_(static_cast<double>(high) - low_) {
    for (std::size_t k = 0; k < kFaces; ++k) {
      faces_[k] = static_cast<float>(low_ + width_ * (static_cast<double>(k) / kBins));
    }
    faces_.front() = low;
    faces_.back() = high;
    per_unit_ = width_ > 0 ? kBins / width_ : 0;
  }

  float operator[](std::size_t k) const { return faces_[k]; }

  // Faces <= x and faces < x. The division only guesses: the faces themselves are rounded, and the
  // counts must agree with what SideOf() will say.
  std::size_t CountUpTo(float x) const {
    std::size_t k = Guess(x);
    while (k < kFaces && faces_[k] <= x) ++k;
    while (k > 0 && faces_[k - 1] > x) --k;
    return k;
  }
  std::size_t CountBelow(float x) const {
    std::size_t k = Guess(x);
    while (k < kFaces && faces_[k] < x) ++k;
    while (k > 0 && faces_[k - 1] >= x) --k;
    return k;
  }

 private:
  std::size_t Guess(float x) const {
    return static_cast<std::size_t>((static_cast<double>(x) - low_) * per_unit_) + 1;
  }

  double low_, width_, per_unit_;
  std::array<float, kFaces> faces_;
};

// References by the faces they begin and end at, for one axis.
struct AxisCounts {
  std::array<std::uint32_t, kFaces + 1> begin{};   // [k]: k faces are <= the lower end
  std::array<std::uint32_t, kFaces + 1> end{};     // [k]: k faces are < the upper end
  std::array<std::uint32_t, kFaces + 1> planar{};  // [k]: lies in face k

  void Add(const Faces& faces, float low, float high) {
    const std::size_t b = faces.CountUpTo(low);
    const std::size_t e = faces.CountBelow(high);
    ++begin[b];
    ++end[e];
    if (b > e) ++planar[e];  // low == high == faces[e]
  }
  void Add(const AxisCounts& other) {
    for (std::size_t k = 0; k <= kFaces; ++k) {
      begin[k] += other.begin[k];
      end[k] += other.end[k];
      planar[k] += other.planar[k];
    }
  }
};

struct Counts {
  std::array<AxisCounts, 3> axes;

  void Add(const Counts& other) {
    for (std::size_t a = 0; a < 3; ++a) axes[a].Add(other.axes[a]);
  }
};

Counts Count(std::span<const Reference> references, const std::array<Faces, 3>& faces) {
  Counts counts;
  for (const Reference& reference : references) {
    for (int axis = 0; axis < 3; ++axis) {
      const std::size_t a = static_cast<std::size_t>(axis);
      counts.axes[a].Add(faces[a], reference.bounds.min[axis], reference.bounds.max[axis]);
    }
  }
  return counts;
}

}  // namespace

std::optional<SplitCandidate> FindBinnedSplit(std::span<const Reference> references,
                                              const Bounds3f& cell, const SahCost& cost) {
  const Bounds3f bounds = UnionBounds(references);
  if (bounds.IsEmpty()) return std::nullopt;

  const std::array<Faces, 3> faces = {Faces(bounds.min.x, bounds.max.x),
                                      Faces(bounds.min.y, bounds.max.y),
                                      Faces(bounds.min.z, bounds.max.z)};
  const Counts counts = ReduceReferences<Counts>(
      references, [&](std::span<const Reference> chunk) { return Count(chunk, faces); });

  SplitSearch search(cost, cell, references.size());
  for (int axis = 0; axis < 3; ++axis) {
    const AxisCounts& axis_counts = counts.axes[static_cast<std::size_t>(axis)];
    const Faces& axis_faces = faces[static_cast<std::size_t>(axis)];
    SplitSearch::Axis candidates(&search, axis);
    std::size_t below = 0;                  // lower end < face k
    std::size_t above = references.size();  // upper end > face k
    for (std::size_t k = 0; k < kFaces; ++k) {
      below += axis_counts.begin[k];
      above -= axis_counts.end[k];
      // Faces coincide where the references' bounds are a few floats wide, or flat.
      if (k > 0 && axis_faces[k] == axis_faces[k - 1]) continue;
      candidates.Consider(axis_faces[k], below, axis_counts.planar[k], above);
    }
  }
  return search.best();
}

}  // namespace kdray::core
