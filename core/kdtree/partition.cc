#include "core/kdtree/partition.h"

#include <algorithm>
#include <array>

namespace kdray::core {

namespace {

std::array<Vec3d, 3> LocalCorners(const TriangleMesh& mesh, PrimitiveId id) {
  const TriangleIndices& indices = mesh.triangles()[id];
  return mesh.VisitVertices([&](auto vertices) -> std::array<Vec3d, 3> {
    return {Vec3d(vertices[indices[0]]), Vec3d(vertices[indices[1]]), Vec3d(vertices[indices[2]])};
  });
}

}  // namespace

ClippedHalves CutReference(const TriangleMesh& mesh, const Reference& reference,
                           const Bounds3f& cell, const SplitPlane& plane) {
  // Clip to the cell rather than to the reference's bounds: its faces are fewer, and exact.
  return ClippedHalfBounds(LocalCorners(mesh, reference.id), cell, reference.bounds, plane.axis,
                           plane.position);
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
                      Reference* above, Reference* cut) {
  SideCounts counts;
  std::size_t cut_count = 0;
  for (std::size_t i = 0; i < references.size(); ++i) {
    // Each is written to all three places and stays in one: branches could not be foretold.
    const Float4 low = LowOf(references[i]);
    const Float4 high = HighOf(references[i]);
    const unsigned side = static_cast<unsigned>(SideOf(references[i], split));
    const unsigned both = side & side >> 1;
    StoreReference(low, high, &below[counts.below]);
    StoreReference(low, high, &above[counts.above]);
    StoreReference(low, high, &cut[cut_count]);
    counts.below += (side & 1u) ^ both;
    counts.above += (side >> 1) ^ both;
    cut_count += both;
  }
  for (const Reference& reference : std::span(cut, cut_count)) {
    const ClippedHalves parts = CutReference(mesh, reference, cell, split.plane);
    if (!parts.below.IsEmpty()) below[counts.below++] = {parts.below, reference.id};
    if (!parts.above.IsEmpty()) above[counts.above++] = {parts.above, reference.id};
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
    // Distribute() writes beyond what it keeps.
    std::vector<Reference> scratch(3 * chunk.size());
    Reference* const chunk_below = scratch.data();
    Reference* const chunk_above = chunk_below + chunk.size();
    used[c] =
        Distribute(mesh, chunk, cell, split, chunk_below, chunk_above, chunk_above + chunk.size());
    std::copy_n(chunk_below, used[c].below, below->data() + start[c].below);
    std::copy_n(chunk_above, used[c].above, above->data() + start[c].above);
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
