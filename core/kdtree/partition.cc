#include "core/kdtree/partition.h"

#include <algorithm>
#include <array>

#include "core/geometry/clip.h"

namespace kdray::core {

namespace {

std::array<Vec3d, 3> LocalCorners(const TriangleMesh& mesh, PrimitiveId id) {
  return {mesh.LocalCorner(id, 0), mesh.LocalCorner(id, 1), mesh.LocalCorner(id, 2)};
}

}  // namespace

ReferenceParts CutReference(const TriangleMesh& mesh, const Reference& reference,
                            const Bounds3f& cell, const SplitPlane& plane) {
  const std::array<Vec3d, 3> corners = LocalCorners(mesh, reference.id);
  // Clip to the cell rather than to the reference's bounds: its faces are fewer, and exact.
  return {
      Intersection(ClippedBounds(corners, plane.BelowCell(cell)), reference.bounds),
      Intersection(ClippedBounds(corners, plane.AboveCell(cell)), reference.bounds),
  };
}

SideCounts CountSides(std::span<const Reference> references, const SplitCandidate& split) {
  SideCounts counts;
  for (const Reference& reference : references) {
    const unsigned side = static_cast<unsigned>(SideOf(reference, split));
    counts.below += side & 1u;
    counts.above += side >> 1;
  }
  return counts;
}

SideCounts Distribute(const TriangleMesh& mesh, std::span<const Reference> references,
                      const Bounds3f& cell, const SplitCandidate& split, Reference* below,
                      Reference* above) {
  SideCounts counts;
  for (const Reference& reference : references) {
    switch (SideOf(reference, split)) {
      case Side::kBelow:
        below[counts.below++] = reference;
        break;
      case Side::kAbove:
        above[counts.above++] = reference;
        break;
      case Side::kBoth: {
        const ReferenceParts parts = CutReference(mesh, reference, cell, split.plane);
        if (!parts.below.IsEmpty()) below[counts.below++] = {parts.below, reference.id};
        if (!parts.above.IsEmpty()) above[counts.above++] = {parts.above, reference.id};
        break;
      }
    }
  }
  return counts;
}

void DistributeInParallel(const TriangleMesh& mesh, std::span<const Reference> references,
                          const Bounds3f& cell, const SplitCandidate& split,
                          std::vector<Reference>* below, std::vector<Reference>* above) {
  // Each chunk gets room for all that CountSides promises; the gaps that clipping leaves are closed
  // at the end.
  const std::size_t chunks = ReferenceChunks(references.size());
  std::vector<SideCounts> room(chunks);
  ForEachReferenceChunk(references, [&](std::span<const Reference> chunk, std::size_t c) {
    room[c] = CountSides(chunk, split);
  });

  std::vector<SideCounts> start(chunks);
  SideCounts total;
  for (std::size_t c = 0; c < chunks; ++c) {
    start[c] = total;
    total.below += room[c].below;
    total.above += room[c].above;
  }
  below->resize(total.below);
  above->resize(total.above);

  std::vector<SideCounts> used(chunks);
  ForEachReferenceChunk(references, [&](std::span<const Reference> chunk, std::size_t c) {
    used[c] = Distribute(mesh, chunk, cell, split, below->data() + start[c].below,
                         above->data() + start[c].above);
  });

  SideCounts kept;
  for (std::size_t c = 0; c < chunks; ++c) {
    const auto close_gap = [](std::vector<Reference>* v, std::size_t from, std::size_t count,
                              std::size_t to) {
      if (from != to) std::copy_n(v->data() + from, count, v->data() + to);
    };
    close_gap(below, start[c].below, used[c].below, kept.below);
    close_gap(above, start[c].above, used[c].above, kept.above);
    kept.below += used[c].below;
    kept.above += used[c].above;
  }
  below->resize(kept.below);
  above->resize(kept.above);
}

}  // namespace kdray::core
